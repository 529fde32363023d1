"""`dlokit calibrate` to its end: in an installation, with two cameras that are not parallel, and of the latency.

Runs with what was found converge; tests/unit has one such calibration, and what the commands do with its pictures.
"""

from pathlib import Path

import numpy as np
import pytest
from board_pictures import seen_in_world, workspace_points

from dlokit.app.commands import execute
from dlokit.functional.cameras.calibration_file import CalibrationResidual, MeasuredLatency, read_calibration, read_part
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.rendering import cell_camera

RAISED = Path(__file__).parents[2] / "examples" / "installations" / "raised.toml"


def test_a_calibration_in_an_installation_is_in_its_frame_and_a_run_there_converges_with_it(tmp_path: Path):
    cell, again, lab = tmp_path / "cell", tmp_path / "again", tmp_path / "lab.toml"
    where = ["--installation", str(RAISED)]
    assert execute(["calibrate", "handeye", *where, "--poses", "12", "--out", str(cell)]) == 0
    found = read_calibration(cell / "calibration.toml").T_world_camera
    # The paper's camera stands in the frame of the base, which is the installation's; the table is 80 mm higher.
    paper = cell_camera(CellConfig()).T_world_camera
    assert np.linalg.norm(found.position_m - paper.position_m) < 6e-3  # with 12 poses, and 0.1° at the first joint
    assert execute(["calibrate", "handeye", *where, "--from", str(cell), "--out", str(again)]) == 0
    np.testing.assert_allclose(
        read_calibration(again / "calibration.toml").T_world_camera.position_m, found.position_m, atol=1e-5
    )
    lab.write_text(RAISED.read_text() + '\n[camera]\ncalibration = "cell/calibration.toml"\n')
    goal = ["--goal", "I", "--headless", "--no-record", "--out", str(tmp_path / "run")]
    assert execute(["shape", *goal, "--installation", str(lab)]) == 0


def test_two_cameras_that_are_not_parallel_are_calibrated_and_a_run_rectifies_their_pictures(tmp_path: Path):
    pose, optics, table, run = (tmp_path / name for name in ("handeye", "stereo", "table", "run"))
    separate = ["--separate-cameras"]
    assert execute(["calibrate", "handeye", *separate, "--poses", "12", "--out", str(pose)]) == 0
    camera, true = read_calibration(pose / "calibration.toml"), cell_camera(CellConfig(separate_cameras=True))
    seen = seen_in_world(workspace_points(), true, camera)
    # 1 mm of it is the offset of the first joint, which no camera sees.
    assert np.linalg.norm(seen - workspace_points(), axis=1).max() < 4e-3
    assert execute(["calibrate", "stereo", "--from", str(pose), "--out", str(optics)]) == 0
    residual = read_part(optics / "calibration.toml", CalibrationResidual)
    assert residual is not None
    assert residual.rows_px is not None
    assert residual.rows_px < 0.5
    assert residual.board_m is not None
    assert residual.board_m < 5e-3
    assert residual.corners_m is not None
    file = ["--calibration", str(pose / "calibration.toml")]
    assert execute(["calibrate", "table", *separate, *file, "--out", str(table)]) == 0
    in_cell = ["--cell.separate-cameras", *file]
    assert execute(["shape", "--headless", "--no-record", "--goal", "I", *in_cell, "--out", str(run)]) == 0


def test_the_latency_of_the_cell_is_found_and_the_kept_pictures_give_the_same_again(tmp_path: Path):
    first, again = tmp_path / "first", tmp_path / "again"
    assert execute(["calibrate", "latency", "--out", str(first)]) == 0
    camera, measured = (
        read_calibration(first / "calibration.toml"),
        read_part(first / "calibration.toml", MeasuredLatency),
    )
    assert camera.stamps_late_s == pytest.approx(0.08, abs=0.002)  # a drift of 50 ppm makes 1 ms in 20 s
    assert camera.serial == "simulated"
    assert measured is not None
    assert measured.uncertainty_s < 0.002
    kept = ["--from", str(first), "--calibration", str(first / "calibration.toml")]
    assert execute(["calibrate", "latency", *kept, "--out", str(again)]) == 0
    assert read_calibration(again / "calibration.toml").stamps_late_s == pytest.approx(camera.stamps_late_s, abs=1e-6)
