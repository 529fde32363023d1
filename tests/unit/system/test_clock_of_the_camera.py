"""A whole run whose camera's clock drifts and jumps: it is named, nothing is planned on it, and the run converges."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlokit.communication.component import Component
from dlokit.decision.flow import FaultKind
from dlokit.functional.cell.component import CellComponent
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import read_recording
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import run_lockstep
from dlokit.system.shaping import Watcher
from dlokit.types.dlo import DloState
from dlokit.types.flow import FlowStatus, RunOutcome
from dlokit.types.image import StereoImages
from dlokit.types.outcome import CallBegun, CallRecord

JUMP_NS = 1_000_000_000
DRIFT_PPM = 50.0
NEAR_NS = 20_000_000
"""A stamp differs from the time of its exposure by less [ns]: the drift within a run, and the camera's 10 ms tick."""


class JumpingCell:
    """Builds the components of a run, and sets the camera's clock forward when the flow comes to a step."""

    def __init__(self, *steps: str) -> None:
        self.steps = list(steps)
        self.cell: CellComponent | None = None

    def build(self, name: str, config: RunConfig, wiring: Wiring) -> Component:
        built = build_component(name, config, wiring)
        if isinstance(built, CellComponent):
            self.cell = built
        return built

    def entered(self, status: FlowStatus) -> None:
        if self.steps and status.step == self.steps[0]:
            self.steps.pop(0)
            assert self.cell is not None
            self.cell.camera_clock.jump(JUMP_NS)


class Steps(Watcher):
    def __init__(self, cell: JumpingCell) -> None:
        self.cell = cell

    def step(self, status: FlowStatus) -> None:
        self.cell.entered(status)


@pytest.mark.heavy
def test_a_jump_of_a_second_is_named_no_motion_is_planned_on_it_and_the_task_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    config = RunConfig(seed=3, headless=True)
    config = replace(config, cell=replace(config.cell, camera_drift_ppm=DRIFT_PPM))
    cell = JumpingCell("track_model", "release")  # before the first action, and before the look after it
    with caplog.at_level(logging.WARNING, logger="dlokit.decision"):
        record = run_lockstep(config, job_from_config(config), tmp_path, Steps(cell), cell.build)
    assert cell.steps == []
    assert record.result.outcome is RunOutcome.CONVERGED

    assert len(record.result.interruptions) == 2
    for why in record.result.interruptions:
        assert "clock_jumped" in why
        assert "+1.000 s" in why
    assert sum("clock_jumped" in line for line in caplog.messages) == 2

    recorded = list(read_recording(tmp_path / FILE_NAME))
    flow = [one.message for one in recorded if isinstance(one.message, FlowStatus)]
    assert [status.last_outcome for status in flow if status.step == "restore"] == [FaultKind.LOST.value] * 2
    pictures = [one for one in recorded if isinstance(one.message, StereoImages)]
    assert len(pictures) > 5
    off_ns = [one.log_ns - one.message.stamp_ns for one in pictures if isinstance(one.message, StereoImages)]
    assert np.abs(off_ns).max() < NEAR_NS  # no picture with a jumped stamp was let in, and the drift is followed
    seen_ns = [(one.log_ns, one.message.observed_stamp_ns) for one in recorded if isinstance(one.message, DloState)]
    assert all(observed_ns <= log_ns + NEAR_NS for log_ns, observed_ns in seen_ns)

    calls = [one.message for one in recorded if isinstance(one.message, CallBegun | CallRecord)]
    since_jump = False
    for call in calls:
        if not isinstance(call, CallRecord):
            assert not (since_jump and call.skill == planning.PROPOSE.key)
        elif call.skill == perception.LOOK.key:
            since_jump = "clock_jumped" in str(call.outcome)
