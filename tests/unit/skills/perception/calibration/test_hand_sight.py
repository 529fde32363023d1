"""The camera's pose from the hand, in rendered images with a known error of the calibrated pose."""

import dataclasses

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from stereo_scene import Scene, calibration, camera_pose, render, s_curve

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.errors import SkillFailure
from dlokit.geometry.camera import project
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.skills.perception.calibration import arm_outline as arm_outline_module
from dlokit.skills.perception.calibration import hand_sight
from dlokit.skills.perception.calibration.arm_outline import arm_outline
from dlokit.skills.perception.calibration.hand_sight import HandLook, camera_from_hand, corrected_by, difference
from dlokit.types.image import StereoImages
from dlokit.types.pose import Pose

PLACES = ((0.50, 0.14, np.pi / 2), (0.50, -0.14, -np.pi / 2))


def scene_at(x_m: float, y_m: float, yaw_rad: float) -> Scene:
    kinematics = ArmKinematics(PANDA)
    q = kinematics.inverse(geometry.downward([x_m, y_m, 0.15], yaw_rad))
    scene = render(s_curve(), q_rad=q)
    return dataclasses.replace(scene, robot=msgspec.structs.replace(scene.robot, T_world_tcp=kinematics.forward(q)))


@pytest.fixture(scope="module")
def hand_looks() -> list[HandLook]:
    return [
        HandLook(images=scene.images, robot=PosedArm(PANDA, scene.robot))
        for scene in (scene_at(*place) for place in PLACES)
    ]


def believed(images: StereoImages, offset_m: tuple[float, float], yaw_deg: float, lift_m: float = 0.0) -> StereoImages:
    """The stereo pair with a perturbed calibrated pose of the camera."""
    turn = Rotation.from_euler("z", yaw_deg, degrees=True)
    center = np.array([0.5, 0.0, 0.0])
    T = images.calibration.T_world_camera
    place = center + turn.apply(T.position_m - center) + np.array([*offset_m, lift_m])
    wrong = geometry.pose(place, (turn * Rotation.from_quat(T.wxyz, scalar_first=True)).as_quat(scalar_first=True))
    return msgspec.structs.replace(
        images, calibration=msgspec.structs.replace(images.calibration, T_world_camera=wrong)
    )


def table_error_m(T_world_camera: Pose) -> float:
    """Error of reconstructed points of the table with a calibrated pose, root mean square [m]."""
    x, y = np.meshgrid([0.3, 0.5, 0.7], [-0.25, 0.0, 0.25])
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(9)])
    pixels = project(places, calibration()).pixels
    wrong = msgspec.structs.replace(calibration(), T_world_camera=T_world_camera)
    fx, cx, cy = wrong.fx_px, wrong.cx_px, wrong.cy_px
    rays = np.column_stack([(pixels - [cx, cy]) / fx, np.ones(9)]) @ geometry.rotation(T_world_camera).T
    seen = T_world_camera.position_m - rays * (T_world_camera.position_m[2] / rays[:, 2])[:, None]
    return float(np.sqrt(np.mean(np.sum((seen - places) ** 2, axis=1))))


@pytest.mark.parametrize(
    ("offset_m", "yaw_deg", "lift_m"),
    [((0.0, 0.0), 0.0, 0.0), ((0.004, -0.003), 0.2, 0.0), ((-0.005, 0.005), -0.2, 0.001), ((0.012, 0.0), 0.0, 0.0)],
)
def test_a_shift_and_a_turn_of_the_camera_are_found_to_a_millimetre(
    s_scene: Scene, hand_looks: list[HandLook], offset_m: tuple[float, float], yaw_deg: float, lift_m: float
):
    background = believed(s_scene.images, offset_m, yaw_deg, lift_m)
    check = camera_from_hand(background, hand_looks)
    assert abs(np.degrees(check.yaw_rad) + yaw_deg) < 0.1
    assert table_error_m(corrected_by(background.calibration.T_world_camera, check)) < 0.001
    assert check.scatter_m < 0.0003
    assert check.points > 800  # both images of both observations show most of the outline


def test_half_a_turn_between_two_observations_cancels_an_offset_of_the_hand(
    s_scene: Scene, hand_looks: list[HandLook], monkeypatch: pytest.MonkeyPatch
):
    """Shift the model's hand by 2 mm from the real one; the other links stay."""
    right = arm_outline_module.link_transforms

    def wrong(arm: ArmModel, q_rad: np.ndarray, finger_width_m: float, T_world_base: Pose | None) -> np.ndarray:
        frames = right(arm, q_rad, finger_width_m, T_world_base).copy()
        hand = PANDA.links.index("hand")
        frames[:, hand, :3, 3] += 0.002 * frames[:, hand, :3, 0]
        return frames

    monkeypatch.setattr(arm_outline_module, "link_transforms", wrong)
    check = camera_from_hand(s_scene.images, hand_looks)
    assert table_error_m(corrected_by(camera_pose(), check)) < 0.001


def test_pictures_without_the_hand_are_refused(s_scene: Scene, hand_looks: list[HandLook]):
    empty = [HandLook(images=s_scene.images, robot=look.robot) for look in hand_looks]
    with pytest.raises(SkillFailure, match="few_points"):
        camera_from_hand(s_scene.images, empty)


def test_inconsistent_images_are_refused(s_scene: Scene, hand_looks: list[HandLook]):
    first, second = hand_looks
    assert isinstance(second.images, StereoImages)
    images = msgspec.structs.replace(
        second.images, left=np.roll(second.images.left, 5, axis=0), right=np.roll(second.images.right, 5, axis=0)
    )
    bent = HandLook(images=images, robot=second.robot)
    with pytest.raises(SkillFailure, match="scattered"):
        camera_from_hand(s_scene.images, [first, bent])


def test_an_implausibly_large_correction_is_refused(
    s_scene: Scene, hand_looks: list[HandLook], monkeypatch: pytest.MonkeyPatch
):
    background = believed(s_scene.images, (0.006, 0.0), 0.0)
    monkeypatch.setattr(hand_sight, "LARGEST_OFFSET_M", 0.005)
    with pytest.raises(SkillFailure, match="too_far"):
        camera_from_hand(background, hand_looks)
    monkeypatch.setattr(hand_sight, "LARGEST_YAW_RAD", 0.003)
    turned = believed(s_scene.images, (0.0, 0.0), 0.4)
    with pytest.raises(SkillFailure, match="too_far"):
        camera_from_hand(turned, hand_looks)


def test_the_outline_surrounds_the_arm_with_outward_normals(s_scene: Scene, hand_looks: list[HandLook]):
    outline = arm_outline(hand_looks[0].robot, calibration())
    assert len(outline.pixels) > 200
    changed = difference(hand_looks[0].images.reference, s_scene.images.reference)
    within, beside = (
        changed[tuple(np.round(outline.pixels + side * outline.normals).astype(int).T[::-1])] for side in (-4.0, 4.0)
    )
    assert np.mean(within > 10.0) > 0.95  # some grains of the table are as bright as the arm's dim parts
    assert np.mean(beside < 10.0) > 0.95  # noise; the fingers are excluded, but may be nearby
    # The points are on the rays of their pixels.
    assert np.abs(project(outline.points_world, calibration()).pixels - outline.pixels).max() < 1e-6
    assert outline.turns_with_hand.any()
    assert not outline.turns_with_hand.all()
