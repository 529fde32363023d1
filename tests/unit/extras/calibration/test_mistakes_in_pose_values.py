"""Mistakes in the poses of an arm that still are poses, a row each: the calibration names them, or finds the camera."""

import dataclasses
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest
from board_pictures import BOARD, angles, lens_camera, shots_of

from dlokit import geometry
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.procedure import calibrate_pose
from dlokit.extras.calibration.stereo_rig import BoardShot
from dlokit.types.pose import Pose

PAIR = lens_camera()
CAMERA = msgspec.structs.replace(PAIR, baseline_m=None, distortion_right=None)
T_OTHER = geometry.pose((0.4, -0.2, 0.05), (0.9, 0.0, 0.0, 0.4))
COUNT = 12
Poses = Sequence[Pose]


def good() -> list[BoardShot]:
    return [dataclasses.replace(shot, right=None, q_rad=None) for shot in shots_of(angles(COUNT), PAIR)]


def each(change: Callable[[Pose], Pose], *numbers: int) -> Callable[[Poses], Poses]:
    """Some poses are others; without numbers, all of them."""
    return lambda poses: [change(T) if not numbers or at in numbers else T for at, T in enumerate(poses)]


def scaled(factor: float) -> Callable[[Pose], Pose]:
    return lambda T: geometry.pose(factor * T.position_m, T.wxyz)


def xyzw(T: Pose) -> Pose:
    return geometry.pose(T.position_m, np.roll(T.wxyz, -1))


def other_hand(T: Pose) -> Pose:
    """As in a left-handed frame whose y axis is turned round."""
    return geometry.pose(T.position_m * (1.0, -1.0, 1.0), T.wxyz * (1.0, -1.0, 1.0, -1.0))


def turned_back(T: Pose) -> Pose:
    return geometry.pose(T.position_m, T.wxyz * (1.0, -1.0, -1.0, -1.0))


def x_and_y_exchanged(T: Pose) -> Pose:
    return geometry.pose(T.position_m[[1, 0, 2]], T.wxyz)


def rounded(place: int, turn: int) -> Callable[[Pose], Pose]:
    return lambda T: geometry.pose(np.round(T.position_m, place), np.round(T.wxyz, turn))


REFUSED: list[tuple[str, Callable[[Poses], Poses], str]] = [
    ("centimetres", each(scaled(100.0)), "centimetres"),
    ("millimetres and x, y, z, w", each(lambda T: xyzw(scaled(1000.0)(T))), "millimetres.*x, y, z, w"),
    (
        "inverted and in millimetres",
        each(lambda T: scaled(1000.0)(geometry.inverse(T))),
        "millimetres.*base in the tool",
    ),
    ("lines two pictures late", lambda poses: [*poses[2:], *poses[:2]], "2 lines"),
    ("lines two pictures early", lambda poses: [*poses[-2:], *poses[:-2]], "2 lines"),
    ("lines in the reverse order", lambda poses: poses[::-1], "mm and .*°"),
    (
        "every second line of a pose 100 mm lower",
        each(lambda T: geometry.lifted(T, -0.1), *range(0, COUNT, 2)),
        "mm and .*°",
    ),
    ("a left-handed frame", each(other_hand), "mm and .*°"),
    ("the turn alone inverted", each(turned_back), "mm and .*°"),
    ("x and y exchanged", each(x_and_y_exchanged), "mm and .*°"),
    ("places rounded to a tenth of a metre", each(rounded(1, 9)), "mm and .*°"),
    ("turns rounded to a tenth", each(rounded(9, 1)), "mm and .*°"),
]

FOUND: list[tuple[str, Callable[[Poses], Poses], Pose | None]] = [
    ("as it should be", each(lambda T: T), None),
    ("rounded to millimetres and three decimals", each(rounded(3, 3)), None),
    ("of the flange", each(lambda T: geometry.compose(T, T_OTHER)), None),
    ("in the frame of a table", each(lambda T: geometry.compose(T_OTHER, T)), T_OTHER),
    ("one line with x and y exchanged", each(x_and_y_exchanged, 6), None),
    ("one line of a later pose, held out", each(lambda T: geometry.lifted(T, 0.05), 4), None),
]


def with_poses(shots: list[BoardShot], change: Callable[[Poses], Poses]) -> list[BoardShot]:
    poses = change([shot.T_world_tcp for shot in shots if shot.T_world_tcp is not None])
    return [dataclasses.replace(shot, T_world_tcp=T) for shot, T in zip(shots, poses, strict=True)]


@pytest.mark.parametrize(("change", "words"), [pytest.param(*row[1:], id=row[0]) for row in REFUSED])
def test_poses_that_contradict_the_pictures_are_refused(change: Callable[[Poses], Poses], words: str):
    with pytest.raises(SkillFailure, match=words):
        calibrate_pose(with_poses(good(), change), BOARD, CAMERA, fit_optics=False)


@pytest.mark.parametrize(("change", "T_frame"), [pytest.param(*row[1:], id=row[0]) for row in FOUND])
def test_poses_that_are_said_otherwise_give_the_same_camera(change: Callable[[Poses], Poses], T_frame: Pose | None):
    found = calibrate_pose(with_poses(good(), change), BOARD, CAMERA, fit_optics=False)
    true = CAMERA.T_world_camera if T_frame is None else geometry.compose(T_frame, CAMERA.T_world_camera)
    assert np.linalg.norm(found.fit.camera.T_world_camera.position_m - true.position_m) < 4e-3
    assert len(found.fit.shots) >= COUNT - 1


def without_poses(shots: list[BoardShot], *numbers: int) -> list[BoardShot]:
    return [dataclasses.replace(shot, T_world_tcp=None) if at in numbers else shot for at, shot in enumerate(shots)]


def test_pictures_without_a_pose_are_left_out_of_all_fits():
    shots = good()
    found = calibrate_pose(without_poses(shots, 2, 4), BOARD, CAMERA, fit_optics=False)
    others = calibrate_pose(
        [shot for at, shot in enumerate(shots) if at not in (2, 4)], BOARD, CAMERA, fit_optics=False
    )
    np.testing.assert_array_equal(found.apart.position_m, others.apart.position_m)
    assert len(found.apart.position_m) == len(found.kept) == 2


def test_too_few_pictures_with_a_pose_are_counted():
    with pytest.raises(SkillFailure, match="9 pictures show the board and have a pose of the arm, at least 10"):
        calibrate_pose(without_poses(good(), 0, 1, 2), BOARD, CAMERA, fit_optics=False)
