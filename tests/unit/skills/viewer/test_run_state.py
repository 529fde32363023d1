import pytest

from dlokit.skills.viewer.state import RunState, after_status, of_phase
from dlokit.types.flow import FlowStatus, RunOutcome, RunPhase


def _status(outcome: RunOutcome | None = None) -> FlowStatus:
    return FlowStatus(stamp_ns=1, flow="shape", step="look", outcome=outcome)


def test_a_step_means_running_and_an_outcome_means_ended() -> None:
    assert after_status(RunState.WAITING, _status()) is RunState.RUNNING
    assert after_status(RunState.ENDED, _status()) is RunState.RUNNING
    assert after_status(RunState.RUNNING, _status(RunOutcome.STALLED)) is RunState.ENDED


def test_a_late_report_does_not_end_a_pause_but_an_outcome_does() -> None:
    assert after_status(RunState.PAUSED, _status()) is RunState.PAUSED
    assert after_status(RunState.PAUSED, _status(RunOutcome.CANCELLED)) is RunState.ENDED


@pytest.mark.parametrize(
    ("phase", "state"),
    [
        (RunPhase.STARTING, RunState.WAITING),
        (RunPhase.WAITING, RunState.WAITING),
        (RunPhase.RUNNING, RunState.RUNNING),
        (RunPhase.ASKING, RunState.RUNNING),
        (RunPhase.PAUSED, RunState.PAUSED),
        (RunPhase.FINISHING, RunState.ENDED),
        (RunPhase.ENDED, RunState.ENDED),
    ],
)
def test_each_phase_of_a_run_is_a_state_of_its_task(phase: RunPhase, state: RunState) -> None:
    assert of_phase(phase) is state
