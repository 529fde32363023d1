"""What the calibrations keep in a folder, and the frames in which they keep it, without a cell and without a camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import T_TCP_BOARD
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.default_cameras import default_calibration
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


UR_HEADER = "name,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad"


def poses_of(folder: Path, text: str) -> list[TakenPicture]:
    for number in range(text.count("\n")):
        cv2.imwrite(str(folder / f"left_{number:03d}.png"), np.zeros((6, 8, 3), np.uint8))
    (folder / "poses.csv").write_text(text)
    return read_pictures(folder)


@pytest.mark.parametrize("header", [UR_HEADER, "Name, x, y, z, RX, RY, RZ"])
def test_the_rotation_vectors_of_a_ur_are_read_by_their_headings(header: str, tmp_path: Path):
    turn = np.array([1.2, -2.1, 0.3])
    angles = ",1,2,3,4,5,6"
    half = ",".join(map(repr, (turn * np.pi / np.linalg.norm(turn)).tolist()))  # half a turn, as UR reports it often
    turned, at_half, still = poses_of(
        tmp_path, f"{header}\n000,0.4,0.1,0.3,1.2,-2.1,0.3{angles}\n001,0,0,0,{half}{angles}\n002,0,0,0,0,0,0{angles}"
    )
    assert turned.T_world_tcp is not None
    assert turned.T_world_tcp.position_m.tolist() == [0.4, 0.1, 0.3]
    wanted = Rotation.from_rotvec(turn).as_matrix()
    np.testing.assert_allclose(geometry.rotation(turned.T_world_tcp), wanted, atol=1e-12)
    assert turned.q_rad is not None
    assert turned.q_rad.tolist() == [1, 2, 3, 4, 5, 6]
    assert at_half.T_world_tcp is not None
    assert abs(at_half.T_world_tcp.wxyz[0]) < 1e-12
    assert still.T_world_tcp is not None
    assert still.T_world_tcp.wxyz.tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (f"{UR_HEADER}\n000,0.4,0.1,0.3,120,-30,10", "line 2: the rotation vector has length 124.*in degrees"),
        (f"{UR_HEADER}\n000,0.4,0.1,0.3,1,2", "line 2: 5 numbers; each line is NAME,x,y,z,rx,ry,rz"),
        (f"{UR_HEADER.replace('_rad', '_deg')}\n000,0.4,0.1,0.3,1,2,3", "in degrees; write them in radians"),
        ("name,x,y,z,qw,qx,qy,qz\n000,0.4,0.1,0.3,1,2,0.1", "line 2: 6 numbers.*under the headings rx_rad"),
    ],
)
def test_turns_that_are_no_rotation_vectors_are_named_with_the_headings(text: str, named: str, tmp_path: Path):
    with pytest.raises(InputError, match=named):
        poses_of(tmp_path, text)


def test_the_states_of_a_moving_ur_are_read_by_their_headings(tmp_path: Path):
    cv2.imwrite(str(tmp_path / "left_000.png"), np.zeros((6, 8, 3), np.uint8))
    (tmp_path / "stamps.csv").write_text("name,stamp_ns\n000,5")
    (tmp_path / "states.csv").write_text(
        UR_HEADER.replace("name", "stamp_ns") + "\n1,0.4,0.1,0.3,0,0,0\n9,0.4,0.1,0.3,0,0,3.141592653589793"
    )
    np.testing.assert_allclose(np.abs(read_motion(tmp_path).track.wxyz), [[1, 0, 0, 0], [0, 0, 0, 1]], atol=1e-12)
