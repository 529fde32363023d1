import dataclasses
import itertools

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from stereo_scene import ROPE_RADIUS_M, Scene, calibration, camera_pose, render, s_curve

from dlokit.description.arm.franka import PANDA
from dlokit.errors import SkillFailure
from dlokit.geometry import pose, resample, rotation
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception.api import TOO_MUCH_SEGMENTED
from dlokit.skills.perception.base import Segmentation, SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import BoxConfig, PerceptionConfig
from dlokit.skills.perception.pipeline import (
    Look,
    check_share,
    corrected_camera_pose,
    perceive,
    segmentation_preview,
)
from dlokit.types.arrays import BoolArray
from dlokit.types.image import CameraPictures, Image

CONFIG = PerceptionConfig()


class FailingConfig:
    """Of another package, with an error in its code."""

    name = "failing"

    def build(self) -> Segmentation:
        raise ZeroDivisionError("by the test")


Array = NDArray[np.floating]


def look_at(scene: Scene, config: PerceptionConfig = CONFIG) -> Look:
    return perceive(scene.images, (PosedArm(PANDA, scene.robot),), config, config.segmentation, ROPE_RADIUS_M)


def distance_m(points: Array, scene: Scene) -> Array:
    """Distance of each point to the true centre line."""
    return np.asarray(KDTree(resample(scene.nodes_world, 2000)).query(points)[0])


def overhang_m(points: Array, nodes: Array) -> tuple[float, float]:
    """How far the cloud reaches beyond each end of the centre line, along it [m]."""
    ends: list[float] = []
    for tip, neighbour in itertools.starmap(lambda i, j: (nodes[i], nodes[j]), ((0, 1), (-1, -2))):
        outward = (tip - neighbour) / np.linalg.norm(tip - neighbour)
        near = points[np.linalg.norm(points - tip, axis=1) < 0.03]
        ends.append(float(np.max((near - tip) @ outward)))
    return ends[0], ends[1]


def test_the_cloud_lies_on_the_centre_line_of_a_rope_on_the_table(s_scene: Scene):
    points = look_at(s_scene).observation.points_world
    # The mask is as wide as the rope, so points spread over one radius, 4 mm; a pixel is 1.7 mm.
    assert np.median(distance_m(points, s_scene)) < 0.003
    assert np.percentile(distance_m(points, s_scene), 95) < 0.006


def test_the_cloud_covers_the_whole_rope(s_scene: Scene):
    points = look_at(s_scene).observation.points_world
    gaps = KDTree(points).query(s_scene.nodes_world)[0]
    assert np.max(gaps) < 0.006  # voxels of 4 mm, and the spread across the rope


def test_the_tips_are_neither_eroded_nor_extended(s_scene: Scene):
    for overhang in overhang_m(look_at(s_scene).observation.points_world, s_scene.nodes_world):
        assert abs(overhang) <= 0.005  # the rope's round end reaches 4 mm beyond its last node


def test_a_lifted_rope_along_the_rows_is_not_pulled_down_to_the_table(straight_scene: Scene):
    points = look_at(straight_scene).observation.points_world
    # Along the rows, only the tips determine the depth: half a pixel of disparity (8 mm) is the achievable accuracy.
    assert abs(np.median(points[:, 2]) - 0.1) < 0.008


def test_a_segmentation_that_takes_the_table_for_dlo_is_named_with_its_share_and_its_setting(s_scene: Scene):
    light = np.full_like(s_scene.images.left, 215)
    images = msgspec.structs.replace(s_scene.images, left=light, right=light)
    with pytest.raises(SkillFailure) as failed:
        perceive(images, (PosedArm(PANDA, s_scene.robot),), CONFIG, CONFIG.segmentation, ROPE_RADIUS_M)
    assert failed.value.reason == TOO_MUCH_SEGMENTED
    assert "brightness takes 100% of the picture" in failed.value.detail
    assert "--segmentation brightness --help" in failed.value.detail


def test_a_hose_of_40_mm_from_near_and_a_box_drawn_around_a_dlo_are_not_too_much():
    near = np.zeros((480, 640), dtype=np.bool_)
    near[180:300] = True  # 0.2 m away, at a focal length of 600 px, through the whole picture
    check_share(near, np.ones_like(near), "brightness")
    thin = np.zeros_like(near)
    thin[220:260] = True
    check_share(thin, thin, "brightness")
    with pytest.raises(SkillFailure, match="takes 60% of the picture"):
        check_share(np.arange(480)[:, None] < np.full((1, 640), 288), np.ones_like(near), "brightness")


def segmented(images: CameraPictures) -> BoolArray:
    """(height, width) what the segmentation alone takes for DLO."""
    return CONFIG.segmentation.build().mask(Image(stamp_ns=0, pixels=images.reference)).pixels


def test_the_robots_own_points_are_removed():
    over = np.array([-0.1, 0.35, 0.05, -2.2, 0.0, 2.5, 0.8])
    scene = render(s_curve(), q_rad=over)
    look = look_at(scene)
    assert np.count_nonzero(segmented(scene.images)) > 1.5 * np.count_nonzero(look.mask)  # the arm is bright as well
    assert len(look.observation.points_world) > 50
    assert np.max(distance_m(look.observation.points_world, scene)) < 0.02


def test_a_rope_in_the_gripper_keeps_its_points_on_both_sides():
    at_node_20 = np.array([-0.203, 0.415, -0.005, -2.577, 0.013, 2.993, 0.564])  # pads around it, 7 mm above
    scene = render(s_curve(), q_rad=at_node_20)
    points = look_at(scene).observation.points_world
    assert np.max(distance_m(points, scene)) < 0.006  # nothing of the gripper is left
    gaps = np.asarray(KDTree(points).query(scene.nodes_world)[0])
    hidden = np.flatnonzero(gaps > 0.006)
    # Hand and wrist hide a stretch of 0.1 m; the rest of the 0.56 m is seen, to both tips.
    assert len(hidden) < 20
    assert 5 < hidden.min() < 20 < hidden.max() < 30


def test_a_box_around_one_half_keeps_that_half(s_scene: Scene):
    box = BoxConfig(lower_world=(0.2, -0.4, -0.02), upper_world=(0.52, 0.4, 0.25))
    points = look_at(s_scene, dataclasses.replace(CONFIG, box=box)).observation.points_world
    assert len(points) > 50
    assert points[:, 0].max() < 0.525  # the shift to the centre line follows the box filter, and is one radius


def test_a_bright_spot_on_the_table_is_not_the_dlo(s_scene: Scene):
    left = s_scene.images.left.copy()
    left[400:404, 300:304] = 255
    images = msgspec.structs.replace(s_scene.images, left=left)
    look = perceive(images, (PosedArm(PANDA, s_scene.robot),), CONFIG, CONFIG.segmentation, ROPE_RADIUS_M)
    assert segmented(images)[402, 302]
    assert not look.mask[402, 302]


def test_colour_sees_the_yellow_rope_and_not_the_white_robot(s_scene: Scene):
    yellow = ColourConfig(lowest_hue_deg=35, highest_hue_deg=70)
    look = look_at(s_scene, dataclasses.replace(CONFIG, segmentation=yellow))
    assert np.max(distance_m(look.observation.points_world, s_scene)) < 0.015


def test_a_picture_without_dlo_gives_an_observation_without_points(s_scene: Scene):
    nothing = dataclasses.replace(CONFIG, segmentation=BrightnessConfig(lowest=255))
    look = look_at(s_scene, nothing)
    assert look.observation.points_world.shape == (0, 3)


def test_a_repeated_observation_is_identical_to_the_bit(s_scene: Scene):
    a, b = look_at(s_scene).observation, look_at(s_scene).observation
    assert a.points_world.tobytes() == b.points_world.tobytes()


def test_the_observation_has_the_stamp_of_the_pictures_and_the_robots_occlusion(s_scene: Scene):
    observation = look_at(s_scene).observation
    assert observation.stamp_ns == s_scene.images.stamp_ns
    assert observation.occlusion is not None
    assert observation.occlusion.depth_m.shape == (70, 80)
    assert np.isfinite(observation.occlusion.depth_m).any()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_tables_plane_corrects_height_and_tilt_of_the_believed_pose(s_scene: Scene, seed: int):
    rng = np.random.default_rng(seed)
    true = camera_pose()
    axis, shift = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    turned = Rotation.from_rotvec(np.radians(0.2) * axis) * Rotation.from_quat(true.wxyz, scalar_first=True)
    believed = pose(true.position_m + 0.003 * shift, turned.as_quat(scalar_first=True))
    images = msgspec.structs.replace(s_scene.images, calibration=calibration(believed))
    found = corrected_camera_pose(images, (PosedArm(PANDA, s_scene.robot),), CONFIG, CONFIG.segmentation)
    assert found is not None
    # A tenth of the introduced error: 3 mm and 0.2 deg; measured 0.01 mm and 0.013 deg.
    assert abs(found.position_m[2] - true.position_m[2]) < 0.0003
    assert np.arccos(min(1.0, rotation(found)[2] @ rotation(true)[2])) < np.radians(0.02)


def test_a_pose_far_off_is_not_corrected(s_scene: Scene):
    believed = pose(camera_pose().position_m + np.array([0.0, 0.0, 0.1]), camera_pose().wxyz)
    images = msgspec.structs.replace(s_scene.images, calibration=calibration(believed))
    assert corrected_camera_pose(images, (PosedArm(PANDA, s_scene.robot),), CONFIG, CONFIG.segmentation) is None


def test_a_table_without_texture_corrects_nothing(s_scene: Scene):
    flat = np.full_like(s_scene.images.left, 40)
    images = msgspec.structs.replace(s_scene.images, left=flat, right=flat)
    assert corrected_camera_pose(images, (PosedArm(PANDA, s_scene.robot),), CONFIG, CONFIG.segmentation) is None


def test_a_preview_shows_the_pixels_that_a_look_uses_and_those_that_it_drops(s_scene: Scene):
    arms = (PosedArm(PANDA, s_scene.robot),)
    low = BrightnessConfig(lowest=100)
    shown = segmentation_preview(s_scene.images, arms, low, CONFIG, 10_000)
    mask = perceive(s_scene.images, arms, CONFIG, low, ROPE_RADIUS_M).mask
    assert ((shown.used == 255) == mask).all()
    taken = low.build().mask(Image(stamp_ns=0, pixels=s_scene.images.left)).pixels
    assert ((shown.dropped == 255) == (taken & ~mask)).all()
    assert (taken & ~mask).any()  # the arm
    assert shown.fraction == mask.mean()
    assert shown.problem == ""


def test_a_preview_is_as_small_as_it_was_asked_for(s_scene: Scene):
    shown = segmentation_preview(s_scene.images, (), BrightnessConfig(), CONFIG, 200)
    assert shown.pixels.shape[1:] == (200, 3)
    assert shown.used.shape == shown.dropped.shape == shown.pixels.shape[:2]


@pytest.mark.parametrize(
    ("segmentation", "says"),
    [
        (BrightnessConfig(lowest=0), "a DLO takes 50% at most"),
        (BrightnessConfig(lowest=255), "No pixel is DLO"),
        (FailingConfig(), "The segmentation failing fails: ZeroDivisionError"),
    ],
)
def test_a_preview_says_why_a_look_would_fail(s_scene: Scene, segmentation: SegmentationConfig, says: str):
    assert says in segmentation_preview(s_scene.images, (), segmentation, CONFIG, 200).problem
