"""Runs without a cell, and dry runs: a recorded camera and arms in software."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlokit.app.commands import execute
from dlokit.app.report.page import report_html, write_report
from dlokit.errors import ConfigError
from dlokit.evaluation.judged_run import judged_run
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import read_recording
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.job import job_from_config
from dlokit.system.results.run_result import read_result
from dlokit.system.shaping import Watcher
from dlokit.system.table import TimeBase, components_of_run, processes_of_run
from dlokit.types.flow import RunOutcome
from dlokit.types.robot import RobotState

PICTURES = RecordedCameraConfig(path="pictures")


@pytest.mark.heavy
def test_a_dry_run_in_the_cell_moves_neither_arm_nor_dlo_and_one_on_its_recording_needs_no_cell(tmp_path: Path) -> None:
    seen, again = tmp_path / "seen", tmp_path / "again"
    seen.mkdir()
    again.mkdir()
    config = RunConfig(seed=3, headless=True, dry_run=True)
    record = judged_run(config, job_from_config(config), seen, Watcher())
    assert record.result.outcome is RunOutcome.DRY_RUN
    assert "the first action would be a " in (record.result.reason or "")
    assert record.actions == ()
    assert record.result.interruptions == ()
    with np.load(seen / "truth.npz") as truth:
        moved_m = np.abs(truth["nodes_world"][-1] - truth["nodes_world"][0]).max()
    assert moved_m < 1e-3  # settling of a rope that nobody touches
    arm = [one.message for one in read_recording(seen / FILE_NAME, {"cell/arm_state"})]
    assert arm == [] or all(isinstance(state, RobotState) for state in arm)
    shown = [one.message for one in read_recording(seen / FILE_NAME, {"robot/state"})]
    joints = np.array([state.q_rad for state in shown if isinstance(state, RobotState)])
    assert np.ptp(joints, axis=0).max() > 0.3  # the motion in software is on the bus, for the viewer
    planned = [one.message for one in read_recording(seen / FILE_NAME, {"planning/action"})]
    assert len(planned) == 1  # and so is the action, with its path and the predicted shape

    without = replace(config, camera=RecordedCameraConfig(path=str(seen), repeat=True))
    assert not without.has_cell
    assert "cell" not in components_of_run(without)
    check_before_start(without)
    record = judged_run(without, job_from_config(without), again, Watcher())
    assert record.result.outcome is RunOutcome.DRY_RUN
    assert not (again / "truth.npz").exists()
    assert read_result(again).true_rmse_m is None
    assert "RMSE to the goal, true" not in write_report(again, report_html(record)).read_text(encoding="utf-8")
    assert execute(["info", str(again)]) == 0
    assert execute(["export", str(again), "--to", "npz", "--out", str(tmp_path / "data")]) == 0


@pytest.mark.parametrize(
    ("config", "says"),
    [
        (RunConfig(headless=True, camera=PICTURES), "does not see the simulated cell"),
        (RunConfig(headless=True, driver=KinematicRobotConfig()), "does not move the arm of the simulated cell"),
        (
            RunConfig(headless=True, camera=RealSenseConfig(), driver=KinematicRobotConfig()),
            "takes pictures in real time; lockstep runs on virtual time",
        ),
    ],
)
def test_a_camera_and_an_arm_of_different_worlds_are_refused(config: RunConfig, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        check_before_start(config)


def test_without_a_cell_all_processes_follow_the_machines_clock() -> None:
    rows = processes_of_run(RunConfig(dry_run=True, camera=RecordedCameraConfig(path="pictures")))
    assert {row.time_base for row in rows} == {TimeBase.MACHINE}
    assert "cell" not in {row.name for row in rows}
