"""The commands of `dlokit calibrate`, in the simulated cell and from the folder of pictures that it leaves."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from dlokit.app.commands import execute
from dlokit.description.arm.franka import PANDA
from dlokit.description.board import CharucoBoard
from dlokit.errors import EXIT_OTHERWISE, ConfigError, InputError
from dlokit.extras.calibration.cell_pictures import cell_config, checked_poses
from dlokit.extras.calibration.charuco import find_board
from dlokit.extras.calibration.commands.folder import read_motion, read_pictures
from dlokit.functional.cameras.calibration_file import (
    CalibrationResidual,
    read_calibration,
    read_part,
    write_calibration,
)
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.depth_rendering import depth_camera
from dlokit.functional.cell.rendering import cell_camera
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.request import RunRequest

TRUE = cell_camera(CellConfig(lens_distortion=True))


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a calibration in the cell."""
    folder = tmp_path_factory.mktemp("calibrate") / "handeye"
    assert execute(["calibrate", "handeye", "--lens-distortion", "--poses", "12", "--out", str(folder)]) == 0
    return folder


def off_m(file: Path) -> float:
    """Distance of a calibrated camera from the true one."""
    return float(np.linalg.norm(read_calibration(file).T_world_camera.position_m - TRUE.T_world_camera.position_m))


def test_the_camera_of_the_cell_is_calibrated(calibrated: Path):
    camera = read_calibration(calibrated / "calibration.toml")
    assert off_m(calibrated / "calibration.toml") < 4e-3  # with 12 poses, and 0.1° at the first joint
    assert camera.serial == "simulated-lens"
    assert camera.date >= "2026"
    assert camera.baseline_m == pytest.approx(TRUE.baseline_m, rel=2e-3)
    residual = read_part(calibrated / "calibration.toml", CalibrationResidual)
    assert residual is not None
    assert residual.pictures == 12
    assert residual.held_out_m is not None
    assert residual.held_out_m < 1e-3
    assert residual.print_scale == pytest.approx(1.002, abs=5e-4)


def test_the_kept_pictures_give_the_same_again(calibrated: Path, tmp_path: Path):
    out = tmp_path / "again"
    assert execute(["calibrate", "handeye", "--from", str(calibrated), "--out", str(out)]) == 0
    first, again = (read_calibration(folder / "calibration.toml") for folder in (calibrated, out))
    np.testing.assert_allclose(first.T_world_camera.position_m, again.T_world_camera.position_m, atol=1e-5)
    assert again.serial == "simulated-lens"


def test_a_single_camera_without_joint_angles_without_a_calibration_and_with_a_line_missing(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    recorded = tmp_path / "recorded"
    recorded.mkdir()
    for picture in calibrated.glob("left_*.png"):
        shutil.copy(picture, recorded)
    rows = [line.split(",")[:8] for line in (calibrated / "poses.csv").read_text().splitlines()]
    (recorded / "poses.csv").write_text("\n".join(",".join(row) for row in rows[:-1]))
    out = tmp_path / "out"
    capsys.readouterr()
    assert execute(["calibrate", "handeye", "--from", str(recorded), "--serial", "7F2A", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "no line in poses.csv: 1 of 12 pictures, 011" in said
    assert "contradict" not in said
    camera = read_calibration(out / "calibration.toml")
    assert camera.serial == "7F2A"
    assert camera.baseline_m is None
    assert off_m(out / "calibration.toml") < 10e-3  # the joints' offsets stay in it


def test_optics_then_pose_then_table(calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    optics, pose = tmp_path / "stereo", tmp_path / "handeye"
    assert execute(["calibrate", "stereo", "--from", str(calibrated), "--out", str(optics)]) == 0
    assert read_calibration(optics / "calibration.toml").fx_px == pytest.approx(TRUE.fx_px, abs=3.0)
    with pytest.raises(ConfigError, match="optics alone"):
        execute(["shape", "--headless", "--calibration", str(optics / "calibration.toml")])
    known = ["--intrinsics", str(optics / "calibration.toml")]
    assert execute(["calibrate", "handeye", "--from", str(calibrated), *known, "--out", str(pose)]) == 0
    assert off_m(pose / "calibration.toml") < 4e-3
    known = ["--calibration", str(pose / "calibration.toml"), "--lens-distortion"]
    assert execute(["calibrate", "table", *known, "--out", str(tmp_path / "table")]) == 0
    assert "the table is at" in capsys.readouterr().out
    wrong = read_calibration(pose / "calibration.toml")
    above_m = wrong.T_world_camera.position_m + np.array([0.0, 0.0, 0.02])
    higher = msgspec.structs.replace(wrong.T_world_camera, position_m=above_m)
    write_calibration(tmp_path / "higher.toml", msgspec.structs.replace(wrong, T_world_camera=higher))
    kept = ["--from", str(tmp_path / "table"), "--calibration", str(tmp_path / "higher.toml")]
    assert execute(["calibrate", "table", *kept, "--out", str(tmp_path / "higher")]) == EXIT_OTHERWISE
    assert "shim the table" in capsys.readouterr().out
    assert read_part(tmp_path / "table" / "calibration.toml", CalibrationResidual) is not None


def test_a_calibration_of_another_camera_is_refused(calibrated: Path, tmp_path: Path):
    file = str(calibrated / "calibration.toml")
    with pytest.raises(ConfigError, match="'simulated-lens', this one is 'simulated'"):
        execute(["shape", "--headless", "--calibration", file, "--out", str(tmp_path / "run")])
    with pytest.raises(ConfigError, match="simulated-lens"):
        execute(["calibrate", "table", "--calibration", file, "--out", str(tmp_path / "table")])


def test_a_run_with_the_calibration_of_its_camera_converges(calibrated: Path, tmp_path: Path):
    out = tmp_path / "run"
    with_file = ["--cell.lens-distortion", "--no-check-camera", "--calibration", str(calibrated / "calibration.toml")]
    assert execute(["shape", "--headless", "--no-record", "--goal", "I", *with_file, "--out", str(out)]) == 0
    assert f'calibration = "{calibrated / "calibration.toml"}"' in (out / "config.toml").read_text()


RAISED = Path(__file__).parents[4] / "examples" / "installations" / "raised.toml"


def test_a_calibration_in_an_installation_is_in_its_frame(calibrated: Path, tmp_path: Path):
    out = tmp_path / "raised"
    where = ["--installation", str(RAISED), "--from", str(calibrated)]
    assert execute(["calibrate", "handeye", *where, "--out", str(out)]) == 0
    first, raised = (read_calibration(folder / "calibration.toml").T_world_camera for folder in (calibrated, out))
    # The poses of the folder are in the frame of the base, which is turned by 90° there; that the table is 80 mm
    # higher, and inclined, changes nothing.
    x, y, z = first.position_m
    np.testing.assert_allclose(raised.position_m, [-y, x, z], atol=1e-4)


@pytest.fixture
def depth_lab(tmp_path: Path) -> Path:
    """An installation with the simulated depth camera."""
    file = tmp_path / "lab.toml"
    file.write_text('[[arms]]\nmodel = "panda"\n[camera.driver]\nkind = "simulated-d435"\n')
    return file


@pytest.mark.heavy
def test_the_installations_camera_is_calibrated_and_a_run_takes_the_result(
    depth_lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "handeye"
    where = ["--installation", str(depth_lab)]
    assert execute(["calibrate", "handeye", *where, "--poses", "12", "--out", str(out)]) == 0
    found, true = read_calibration(out / "calibration.toml"), depth_camera()
    assert (found.serial, found.width_px, found.baseline_m) == (true.serial, true.width_px, None)
    assert np.linalg.norm(found.T_world_camera.position_m - true.T_world_camera.position_m) < 4e-3
    driver, line = "[camera.driver]", 'calibration = "handeye/calibration.toml"'
    assert f"use it: write {line} under [camera] in " in capsys.readouterr().out
    result = f"[camera]\n{line}\n{driver}"
    depth_lab.write_text(depth_lab.read_text().replace(driver, result))
    config = RunRequest(choices={"installation": str(depth_lab)}).configured()
    assert config.calibration
    check_before_start(replace(config, headless=True))


def test_a_camera_that_the_cell_does_not_have_is_not_replaced_by_its_stereo_camera(depth_lab: Path, tmp_path: Path):
    command = ["calibrate", "handeye", "--installation", str(depth_lab), "--out", str(tmp_path / "out")]
    with pytest.raises(InputError, match=r"describe the simulated stereo camera.*simulated-d435"):
        execute([*command, "--lens-distortion"])
    depth_lab.write_text('[camera.driver]\nkind = "realsense"\n')
    with pytest.raises(InputError, match=r"lab\.toml is realsense.*--from DIR"):
        execute(command)
    assert not (tmp_path / "out").exists()


def test_bad_stamps_and_states_are_named(tmp_path: Path):
    cv2.imwrite(str(tmp_path / "left_000.png"), np.zeros((64, 64, 3), np.uint8))
    (tmp_path / "stamps.csv").write_text("name,stamp_ns\n000,soon")
    with pytest.raises(InputError, match="line 2: a stamp"):
        read_motion(tmp_path)
    (tmp_path / "stamps.csv").write_text("name,stamp_ns\n000,5\n001,6")
    with pytest.raises(InputError, match="1 pictures"):
        read_motion(tmp_path)
    (tmp_path / "stamps.csv").write_text("name,stamp_ns\n000,5")
    (tmp_path / "states.csv").write_text("stamp_ns,x\n1,0,0,0,0,0,0,0")
    with pytest.raises(InputError, match="line 2: the quaternion"):
        read_motion(tmp_path)
    (tmp_path / "states.csv").write_text("stamp_ns,x\n2,0,0,0,1,0,0,0\n2,0,0,0,1,0,0,0")
    with pytest.raises(InputError, match="later than"):
        read_motion(tmp_path)


def test_a_printed_board_is_found_by_its_pattern(tmp_path: Path):
    file = tmp_path / "board.png"
    assert execute(["calibrate", "board", "--out", str(file)]) == 0
    picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    small = np.pad(np.asarray(cv2.resize(picture, None, fx=0.1, fy=0.1, interpolation=cv2.INTER_AREA)), 30)
    assert find_board(small.astype(np.uint8), CharucoBoard()) is not None
    with pytest.raises(InputError, match="name a new"):
        execute(["calibrate", "board", "--out", str(file)])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["handeye", "--seed", "-1"], "--seed is -1"),
        (["handeye", "--poses", "9"], "--poses is 9"),
        (["handeye", "--board.square-m", "0.05"], "of its own"),
        (["table", "--from", "."], "needs --calibration"),
        (["latency", "--from", "."], "needs --calibration"),
    ],
)
def test_bad_input_is_named(arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        execute(["calibrate", *arguments, "--out", str(tmp_path / "out")])


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ("name,x,y\n000,1,2", "line 2: 2 numbers"),
        ("name\n000,a,0,0,1,0,0,0", "line 2: could not convert"),
        ("name\n000,0,0,0,0,0,0,0", "line 2: the quaternion"),
        ("name\n000,0,0,0,1,0,0,0,9,9,9,9,9,9\n001,0,0,0,1,0,0,0,9,9", "line 3: 9 numbers, and 13 in the lines before"),
    ],
)
def test_bad_poses_are_named_by_their_line(poses: str, message: str, tmp_path: Path):
    cv2.imwrite(str(tmp_path / "left_000.png"), np.zeros((64, 64, 3), np.uint8))
    (tmp_path / "poses.csv").write_text(poses)
    with pytest.raises(InputError, match=message):
        read_pictures(tmp_path)


def test_a_folder_without_pictures_or_with_damaged_ones_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no left_"):
        read_pictures(tmp_path)
    (tmp_path / "left_1.png").write_text("not a picture")
    with pytest.raises(InputError, match="not a picture"):
        read_pictures(tmp_path)


def test_too_few_pictures_are_refused(calibrated: Path, tmp_path: Path):
    for number in range(9):
        shutil.copy(calibrated / f"left_{number:03d}.png", tmp_path)
    shutil.copy(calibrated / "poses.csv", tmp_path)
    with pytest.raises(InputError, match="9 pictures show the board, at least 10"):
        execute(["calibrate", "handeye", "--from", str(tmp_path), "--out", str(tmp_path / "out")])


def test_a_dry_run_checks_all_motions_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    assert execute(["calibrate", "latency", "--dry-run"]) == 0
    assert "13 of 13 motions pass all checks" in " ".join(capsys.readouterr().out.split())
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="moves no arm"):
        execute(["calibrate", "handeye", "--dry-run", "--from", "pictures"])


def test_a_dry_run_names_each_motion_that_is_refused_and_moves_no_arm():
    beyond_rad = PANDA.home_q_rad + np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    poses = [PANDA.home_q_rad + 0.05, beyond_rad, PANDA.home_q_rad - 0.05]
    asked: list[tuple[int, int]] = []
    config = cell_config(1, held=True, lens_distortion=False)
    checked = checked_poses(config, lambda camera: poses, lambda *done: asked.append(done), 0.0)
    assert asked == [(1, 3), (2, 3), (3, 3)]
    (refused,) = checked.refused
    assert refused.startswith("pose 2: joint_limit")
    assert checked.duration_s > 0.5
