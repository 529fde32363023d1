import pytest

from dlokit.skills.viewer.state import RunState, after_command, after_status
from dlokit.types.flow import Command, FlowStatus, RunOutcome


def _status(outcome: RunOutcome | None = None) -> FlowStatus:
    return FlowStatus(stamp_ns=1, flow="shape", step="look", outcome=outcome)


def test_a_step_means_running_and_an_outcome_means_ended() -> None:
    assert after_status(RunState.WAITING, _status()) is RunState.RUNNING
    assert after_status(RunState.ENDED, _status()) is RunState.RUNNING
    assert after_status(RunState.RUNNING, _status(RunOutcome.STALLED)) is RunState.ENDED


def test_a_late_report_does_not_end_a_pause_but_an_outcome_does() -> None:
    assert after_status(RunState.PAUSED, _status()) is RunState.PAUSED
    assert after_status(RunState.PAUSED, _status(RunOutcome.CANCELLED)) is RunState.ENDED


@pytest.mark.parametrize("command", [Command.RESUME, Command.STOP])
def test_a_pause_ends_with_resume_and_stop(command: Command) -> None:
    assert after_command(RunState.PAUSED, command) is RunState.RUNNING


def test_a_start_does_not_end_a_pause() -> None:
    assert after_command(RunState.PAUSED, Command.START) is RunState.PAUSED


def test_only_a_running_task_can_pause() -> None:
    assert after_command(RunState.RUNNING, Command.PAUSE) is RunState.PAUSED
    assert after_command(RunState.WAITING, Command.PAUSE) is RunState.WAITING
