"""A run that signals end has a result whenever they come, and however often."""

import asyncio
import os
import signal
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from dlokit.app.shape.shape import exit_code
from dlokit.errors import EXIT_OTHERWISE
from dlokit.evaluation.judged_run import judged_run
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.system import live
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import run_lockstep
from dlokit.system.results.run_result import read_result
from dlokit.system.shaping import Watcher
from dlokit.types.flow import FlowStatus, RunOutcome

CONFIG = RunConfig(headless=True, seed=3)


class Impatient(Watcher):
    """Presses Ctrl-C at the first step, and again whenever it is told that the run stops."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def step(self, status: FlowStatus) -> None:
        if not self.told:
            os.kill(os.getpid(), signal.SIGINT)

    def stopping(self, by: str) -> None:
        self.told.append(by)
        os.kill(os.getpid(), signal.SIGINT)


def test_a_run_that_is_stopped_while_it_starts_has_a_result_and_misses_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @asynccontextmanager
    async def starts(*_: object) -> AsyncGenerator[None]:
        os.kill(os.getpid(), signal.SIGINT)
        await asyncio.sleep(60.0)
        yield

    monkeypatch.setattr(live, "started", starts)
    record = judged_run(CONFIG, job_from_config(CONFIG), tmp_path, Watcher(), live.run_live)

    result = read_result(tmp_path)
    assert result.outcome is RunOutcome.CANCELLED
    assert result.reason == "nothing has moved: stopped by SIGINT (Ctrl-C) while the system started"
    assert record.unwritten == {}
    assert exit_code(record) == EXIT_OTHERWISE


def test_a_second_ctrl_c_takes_nothing_from_a_run_that_winds_up(tmp_path: Path) -> None:
    watch = Impatient()
    record = run_lockstep(CONFIG, job_from_config(CONFIG), tmp_path, watch)

    assert watch.told == ["SIGINT (Ctrl-C)"]
    assert record.begun
    assert record.result.outcome is RunOutcome.CANCELLED
    assert record.result.reason == "stopped by SIGINT (Ctrl-C)"


class Calm(Watcher):
    """Ends the task while the DLO is grasped."""

    def started(self, cancel: Callable[[], object]) -> None:
        self._cancel = cancel

    def step(self, status: FlowStatus) -> None:
        if status.step == "grasp":
            self._cancel()


def test_the_result_of_a_run_that_is_stopped_in_its_first_action_counts_it(tmp_path: Path) -> None:
    config = RunConfig(headless=True, seed=3, planning=PlanningConfig(strategy=FarthestConfig()))
    result = run_lockstep(config, job_from_config(config), tmp_path, Calm()).result
    assert result.outcome is RunOutcome.CANCELLED
    assert (result.actions, result.history) == (1, ())
