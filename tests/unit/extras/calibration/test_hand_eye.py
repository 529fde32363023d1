import dataclasses

import msgspec
import numpy as np
import pytest
from board_pictures import (
    BOARD,
    T_TCP_BOARD,
    angles,
    lens_camera,
    seen_in_world,
    separate_camera,
    shots_of,
    workspace_points,
)
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import arm_model
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.hand_eye import fit_hand_eye, held_out
from dlokit.extras.calibration.stereo_rig import BoardShot
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration

CAMERA = lens_camera()


def given() -> CameraCalibration:
    """The optics of the camera, at a pose that is far from the true one."""
    return msgspec.structs.replace(CAMERA, T_world_camera=geometry.pose((0.0, 0.0, 0.0)))


def turn_deg(camera: CameraCalibration) -> float:
    R = geometry.rotation(CAMERA.T_world_camera).T @ geometry.rotation(camera.T_world_camera)
    return float(np.degrees(Rotation.from_matrix(R).magnitude()))


def off_m(camera: CameraCalibration) -> float:
    return float(np.linalg.norm(camera.T_world_camera.position_m - CAMERA.T_world_camera.position_m))


def test_the_camera_is_found_without_any_idea_of_where_it_is():
    fit = fit_hand_eye(shots_of(angles(12), CAMERA), BOARD, given())
    assert off_m(fit.camera) < 5e-4
    assert turn_deg(fit.camera) < 0.03
    assert fit.rms_px < min(fit.rms_by_method_px.values())
    assert np.all(fit.deviation_m(np.array([[0.5, 0.0, 0.0]])) < 2e-3)


def test_the_scale_of_the_print_and_the_offsets_of_the_middle_joints_are_found():
    offsets = np.radians([0.0, 0.1, -0.1, 0.1, -0.1, 0.1, 0.0])
    shots = shots_of(angles(20), CAMERA, scale=1.002, offsets_rad=offsets)
    fit = fit_hand_eye(shots, BOARD, given())
    assert fit.print_scale == pytest.approx(1.002, abs=3e-4)
    assert fit.joint_offsets_rad is not None
    assert np.degrees(np.abs(fit.joint_offsets_rad - offsets)).max() < 0.02
    assert off_m(fit.camera) < 1e-3


def test_the_camera_may_be_two_that_are_not_parallel_and_its_pose_is_that_of_the_rectified_frame():
    true = separate_camera()
    unknown = msgspec.structs.replace(true, T_world_camera=geometry.pose((0.0, 0.0, 0.0)))
    fit = fit_hand_eye(shots_of(angles(12), true), BOARD, unknown)
    seen = seen_in_world(workspace_points(), true, fit.camera)
    assert np.linalg.norm(seen - workspace_points(), axis=1).max() < 1e-3


def ur5e_shots(offsets_rad: Float64Array | None = None) -> tuple[ArmModel, CameraCalibration, list[BoardShot]]:
    """A UR5e that turns all joints beside its home, and a camera that the board faces there."""
    arm = arm_model("ur5e")
    rng = np.random.default_rng(0)
    poses = [arm.home_q_rad + rng.uniform(-0.35, 0.35, 6) for _ in range(20)]
    board = geometry.compose(tcp_pose(arm, arm.home_q_rad), T_TCP_BOARD)
    before = geometry.compose(board, geometry.pose((*BOARD.outline_board.mean(axis=0)[:2], -1.0)))
    camera = msgspec.structs.replace(CAMERA, T_world_camera=before)
    return arm, camera, shots_of(poses, camera, offsets_rad=offsets_rad, arm=arm)


def test_joints_of_an_arm_with_six_of_them_are_found_and_which_of_them_can_be_seen_is_said():
    offsets = np.radians([0.0, 0.1, -0.1, 0.1, -0.1, 0.0])
    arm, camera, shots = ur5e_shots(offsets)
    fit = fit_hand_eye(shots, BOARD, given(), arm)
    assert fit.joint_offsets_rad is not None
    assert fit.joint_sigma_rad is not None
    assert np.degrees(np.abs(fit.joint_offsets_rad - offsets)).max() < 0.02
    assert fit.seen_joints == (1, 2, 3, 4)
    assert np.all(np.abs(fit.joint_offsets_rad - offsets)[1:5] < 4 * fit.joint_sigma_rad[1:5])
    assert np.linalg.norm(fit.camera.T_world_camera.position_m - camera.T_world_camera.position_m) < 1e-3


def test_the_poses_may_be_those_of_a_flange_in_the_frame_of_a_table():
    offsets = np.radians([0.0, 0.1, -0.1, 0.1, -0.1, 0.1, 0.0])
    T_table_base = geometry.pose((0.4, -0.2, 0.05), (0.9, 0.0, 0.0, 0.4))
    T_tcp_flange = geometry.pose((0.0, 0.01, -0.1), (0.9, 0.1, 0.0, 0.4))
    shots = [
        dataclasses.replace(
            shot, T_world_tcp=geometry.compose(T_table_base, geometry.compose(shot.T_world_tcp, T_tcp_flange))
        )
        for shot in shots_of(angles(20), CAMERA, offsets_rad=offsets)
        if shot.T_world_tcp is not None
    ]
    fit = fit_hand_eye(shots, BOARD, given())
    expected = geometry.compose(T_table_base, CAMERA.T_world_camera)
    assert np.linalg.norm(fit.camera.T_world_camera.position_m - expected.position_m) < 1e-3
    assert fit.joint_offsets_rad is not None
    assert np.degrees(np.abs(fit.joint_offsets_rad - offsets)).max() < 0.02


def test_joint_angles_of_another_arm_or_in_degrees_are_refused():
    arm, _, shots = ur5e_shots()
    with pytest.raises(SkillFailure, match=r"6 joint angles are given, and the .* has 7 joints"):
        fit_hand_eye(shots, BOARD, given(), PANDA)
    degrees = [dataclasses.replace(shot, q_rad=np.degrees(shot.q_rad)) for shot in shots if shot.q_rad is not None]
    with pytest.raises(SkillFailure, match="in radians"):
        fit_hand_eye(degrees, BOARD, given(), arm)


def test_offsets_of_the_joints_part_what_the_arm_reports_from_what_the_camera_sees():
    offsets = np.radians([0.0, 0.1, -0.1, 0.1, -0.1, 0.1, 0.0])
    shots = shots_of(angles(25), CAMERA, offsets_rad=offsets)
    apart = held_out(fit_hand_eye(shots[:20], BOARD, given()), shots[20:], BOARD)
    assert apart.position_m.max() < 3e-4
    assert apart.reported_m.max() > 1e-3


def test_the_offset_of_the_first_joint_turns_the_world_and_that_of_the_last_the_board():
    offset_rad = np.radians(0.1)
    offsets = np.array([offset_rad, 0.0, 0.0, 0.0, 0.0, 0.0, offset_rad])
    fit = fit_hand_eye(shots_of(angles(20), CAMERA, offsets_rad=offsets), BOARD, given())
    assert fit.joint_offsets_rad is not None
    assert np.degrees(np.abs(fit.joint_offsets_rad)).max() < 0.02
    turned = Rotation.from_euler("z", offset_rad)
    expected = turned.apply(CAMERA.T_world_camera.position_m)
    assert np.linalg.norm(fit.camera.T_world_camera.position_m - expected) < 1e-3


def test_held_out_poses_agree_and_tell_where_the_board_has_slipped():
    shots = shots_of(angles(16), CAMERA, scale=1.002)
    fit = fit_hand_eye(shots[:12], BOARD, given())
    apart = held_out(fit, shots[12:], BOARD)
    assert apart.position_m.max() < 5e-4
    assert np.degrees(apart.angle_rad).max() < 0.2
    assert shots[12].q_rad is not None
    q = shots[12].q_rad + np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0])
    slipped = dataclasses.replace(shots[12], q_rad=q, T_world_tcp=tcp_pose(PANDA, q))
    assert held_out(fit, [slipped], BOARD).position_m[0] > 3e-3


def test_a_picture_that_contradicts_the_others_is_left_out():
    shots = shots_of(angles(20), CAMERA)
    wrong = shots[3]
    assert wrong.q_rad is not None
    q = wrong.q_rad + 0.02
    shots[3] = dataclasses.replace(wrong, q_rad=q, T_world_tcp=tcp_pose(PANDA, q))
    fit = fit_hand_eye(shots, BOARD, given())
    assert off_m(fit.camera) < 5e-4
    assert len(fit.shots) == 19
    assert shots[3] not in fit.shots


def test_without_joint_angles_and_with_one_camera_it_works_too():
    shots = [dataclasses.replace(shot, q_rad=None, right=None) for shot in shots_of(angles(20), CAMERA)]
    single = msgspec.structs.replace(given(), baseline_m=None, distortion_right=None)
    fit = fit_hand_eye(shots, BOARD, single)
    assert off_m(fit.camera) < 1.5e-3
    assert fit.joint_offsets_rad is None
    assert fit.camera.baseline_m is None


def test_too_few_pictures_and_turns_about_one_axis_are_refused():
    shots = shots_of(angles(8), CAMERA)
    with pytest.raises(SkillFailure, match="7 pictures"):
        fit_hand_eye(shots[:7], BOARD, given())
    T = shots[0].T_world_tcp
    assert T is not None
    steady = [dataclasses.replace(shot, T_world_tcp=geometry.lifted(T, 0.01 * i)) for i, shot in enumerate(shots)]
    with pytest.raises(SkillFailure, match="one axis"):
        fit_hand_eye(steady, BOARD, given())
