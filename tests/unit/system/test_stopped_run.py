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
from dlokit.system.results.run_result import RunRecord, read_result
from dlokit.system.shaping import LINGER_S, Watcher
from dlokit.types.flow import FlowStatus, RunOutcome

CONFIG = RunConfig(headless=True, seed=3)


class Impatient(Watcher):
    """Presses Ctrl-C at the first step, and again whenever it is told that the run stops."""

    def __init__(self, *errors: BaseException) -> None:
        """`errors` are raised by the first attempts to tell a person."""
        self.told: list[str] = []
        self.told_at_once: list[str] = []
        self.again = 0
        self._errors = list(errors)

    def step(self, status: FlowStatus) -> None:
        if not self.told_at_once:
            os.kill(os.getpid(), signal.SIGINT)
            self.told_at_once = ["nothing", *self.told]

    def stopping(self, by: str) -> None:
        if self._errors:
            raise self._errors.pop()
        self.told.append(by)
        os.kill(os.getpid(), signal.SIGINT)

    def interrupted_again(self) -> None:
        self.again += 1


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
    assert watch.again == 1
    assert record.begun
    assert record.result.outcome is RunOutcome.CANCELLED
    assert record.result.reason == "stopped by SIGINT (Ctrl-C)"


def test_a_person_is_told_within_the_handler_of_the_signal_although_the_loop_computes_for_seconds(
    tmp_path: Path,
) -> None:
    watch = Impatient()
    run_lockstep(CONFIG, job_from_config(CONFIG), tmp_path, watch)
    assert watch.told_at_once == ["nothing", "SIGINT (Ctrl-C)"]


@pytest.mark.parametrize("error", [RuntimeError("reentrant call"), BrokenPipeError(), SystemExit(1)])
def test_a_person_who_could_not_be_told_in_the_handler_is_told_afterwards_and_the_result_is_kept(
    tmp_path: Path, error: BaseException
) -> None:
    watch = Impatient(error)
    record = run_lockstep(CONFIG, job_from_config(CONFIG), tmp_path, watch)
    assert watch.told == ["SIGINT (Ctrl-C)"]
    assert record.result.reason == "stopped by SIGINT (Ctrl-C)"


def test_a_run_that_is_stopped_before_it_has_released_anything_waits_for_no_shape_to_settle(tmp_path: Path) -> None:
    record = run_lockstep(CONFIG, job_from_config(CONFIG), tmp_path, Impatient())
    assert record.result.history == ()
    assert record.result.sim_time_s < LINGER_S


def test_a_ctrl_c_while_a_run_is_judged_is_answered_and_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judges(config: RunConfig, record: RunRecord, folder: Path, out: Path) -> RunRecord:
        os.kill(os.getpid(), signal.SIGINT)
        return record

    stopped = Impatient()
    first = run_lockstep(CONFIG, job_from_config(CONFIG), tmp_path / "first", stopped)
    watch = Impatient()
    monkeypatch.setattr("dlokit.evaluation.judged_run.judged", judges)
    record = judged_run(CONFIG, job_from_config(CONFIG), tmp_path / "run", watch, lambda *_: first)
    assert watch.again == 1
    assert record.result == first.result


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
