"""What the calibrations keep in a folder, and the frames in which they keep it, without a cell and without a camera."""

from pathlib import Path

import numpy as np
import pytest
from board_pictures import T_TCP_BOARD

from dlokit import geometry
from dlokit.description.scene import default_calibration
from dlokit.errors import InputError
from dlokit.extras.calibration.charuco import BoardView
from dlokit.extras.calibration.commands.folder import (
    RecordedMotion,
    camera_of_folder,
    read_motion,
    read_pictures,
    write_motion,
    write_pictures,
)
from dlokit.extras.calibration.commands.installed import CalibratedInstallation
from dlokit.extras.calibration.commands.pictures import moved_px
from dlokit.extras.calibration.latency import ToolTrack
from dlokit.extras.calibration.procedure import TakenPicture
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.types.arrays import UInt8Array

RAISED = Path(__file__).parents[4] / "examples" / "installations" / "raised.toml"
RNG = np.random.default_rng(0)


def noise(height_px: int = 6) -> UInt8Array:
    return RNG.integers(0, 255, (height_px, 8, 3), dtype=np.uint8)


@pytest.mark.parametrize("joints", [None, np.array([0.1, -0.2, 1.0 / 3.0])])
def test_pictures_and_poses_are_read_as_they_were_written(tmp_path: Path, joints: np.ndarray | None):
    given = [TakenPicture(left=noise(), right=noise(), T_world_tcp=T_TCP_BOARD, q_rad=joints) for _ in range(2)]
    write_pictures(tmp_path, given)
    found = read_pictures(tmp_path)
    assert len(found) == 2
    for one, other in zip(found, given, strict=True):
        np.testing.assert_array_equal(one.left, other.left)
        assert one.right is not None
        assert other.right is not None
        np.testing.assert_array_equal(one.right, other.right)
        assert one.T_world_tcp is not None
        np.testing.assert_array_equal(one.T_world_tcp.position_m, T_TCP_BOARD.position_m)
        np.testing.assert_array_equal(one.T_world_tcp.wxyz, T_TCP_BOARD.wxyz)
        if joints is None:
            assert one.q_rad is None
        else:
            assert one.q_rad is not None
            np.testing.assert_array_equal(one.q_rad, joints)


def test_pictures_of_two_sizes_are_refused(tmp_path: Path):
    write_pictures(tmp_path, [TakenPicture(left=noise()), TakenPicture(left=noise(height_px=5))])
    with pytest.raises(InputError, match="several sizes"):
        read_pictures(tmp_path)


def test_a_motion_is_read_as_it_was_written(tmp_path: Path):
    track = ToolTrack(
        stamps_ns=np.array([1, 2_000_000_001]),
        position_m=RNG.normal(size=(2, 3)),
        wxyz=np.array([[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, -0.5, -0.5]]),
    )
    given = RecordedMotion(pictures=[noise(), noise()], stamps_ns=[7, 2**53 + 1], track=track)
    write_motion(tmp_path, given, default_calibration(8, 6))
    found = read_motion(tmp_path)
    assert found.stamps_ns == given.stamps_ns
    for one, other in zip(found.pictures, given.pictures, strict=True):
        np.testing.assert_array_equal(one, other)
    for name in ("stamps_ns", "position_m", "wxyz"):
        np.testing.assert_array_equal(getattr(found.track, name), getattr(track, name))
    camera = camera_of_folder(tmp_path, given.pictures[0], "", "")
    assert camera.fx_px == default_calibration(8, 6).fx_px


def test_a_folder_without_a_calibration_has_a_camera_of_the_size_of_its_pictures(tmp_path: Path):
    camera = camera_of_folder(tmp_path, noise(), "7F2A", "2026-01-02")
    assert (camera.width_px, camera.height_px, camera.serial, camera.date) == (8, 6, "7F2A", "2026-01-02")
    assert (camera.cx_px, camera.cy_px) == (3.5, 2.5)
    assert camera.fx_px == camera.fy_px > 0.0
    write_calibration(tmp_path / "calibration.toml", default_calibration(8, 6))
    assert camera_of_folder(tmp_path, noise(), "7F2A", "").baseline_m == default_calibration().baseline_m


def test_a_calibration_of_another_size_than_its_pictures_is_refused(tmp_path: Path):
    write_calibration(tmp_path / "calibration.toml", default_calibration(16, 12))
    with pytest.raises(InputError, match="16 by 12 px, these have 8 by 6 px"):
        camera_of_folder(tmp_path, noise(), "", "")


def test_a_right_picture_of_another_size_is_refused(tmp_path: Path):
    write_pictures(tmp_path, [TakenPicture(left=noise(), right=noise(height_px=5))])
    with pytest.raises(InputError, match="several sizes"):
        read_pictures(tmp_path)


def test_an_installation_moves_poses_and_cameras_between_its_frames_and_back():
    raised = CalibratedInstallation(RAISED)
    there = raised.base_to_world(T_TCP_BOARD)
    assert there.position_m[2] < T_TCP_BOARD.position_m[2] - 0.07  # the table, the world's origin, is 80 mm higher
    np.testing.assert_allclose(geometry.matrix(raised.world_to_base(there)), geometry.matrix(T_TCP_BOARD), atol=1e-12)
    camera = default_calibration()
    written = raised.written(camera)
    assert np.linalg.norm(written.T_world_camera.position_m - camera.T_world_camera.position_m) > 0.07
    again = raised.read(written).T_world_camera
    np.testing.assert_allclose(geometry.matrix(again), geometry.matrix(camera.T_world_camera), atol=1e-12)


def test_without_an_installation_poses_and_cameras_stay_as_they_are():
    plain, camera = CalibratedInstallation(None), default_calibration()
    assert plain.base_to_world(T_TCP_BOARD) is T_TCP_BOARD
    assert plain.world_to_base(T_TCP_BOARD) is T_TCP_BOARD
    assert plain.written(camera) is camera


def test_a_board_has_moved_by_the_largest_motion_of_a_corner_that_both_views_show():
    before = BoardView(numbers=np.array([1, 2, 5]), pixels=np.array([[0.0, 0.0], [10.0, 0.0], [50.0, 50.0]]))
    now = BoardView(numbers=np.array([2, 5, 9]), pixels=np.array([[10.0, 1.0], [53.0, 54.0], [0.0, 900.0]]))
    assert moved_px(before, now) == 5.0
    assert moved_px(None, now) == float("inf")
    elsewhere = BoardView(numbers=np.array([7]), pixels=np.array([[0.0, 0.0]]))
    assert moved_px(elsewhere, now) == float("inf")
