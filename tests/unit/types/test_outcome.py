"""An outcome says in one line how a call ended, and gives its result or raises."""

import pytest

from dlokit.errors import SkillFailure, SkillRejected
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, Succeeded, TimedOut, Unreachable


@pytest.mark.parametrize(
    ("outcome", "line"),
    [
        (Succeeded(result=3), "succeeded"),
        (Failed(reason="no_points", detail="the cloud is empty"), "failed no_points: the cloud is empty"),
        (Rejected(reason="busy"), "rejected busy"),
        (Cancelled(), "cancelled"),
        (TimedOut(timeout_s=2.0), "timed out: it had not ended after 2 s and was cancelled"),
        (Unreachable(component="robot"), "unreachable: robot does not answer; it is not running"),
    ],
)
def test_one_line_says_how_a_call_ended(outcome: Outcome[int], line: str) -> None:
    """People read it in the terminal, in the page and in `result.json`."""
    assert str(outcome) == line


def test_the_result_of_a_call_that_succeeded() -> None:
    """Nothing is raised."""
    assert Succeeded(result=3).unwrap() == 3


@pytest.mark.parametrize(
    ("outcome", "kind", "reason", "detail"),
    [
        (Failed(reason="no_points", detail="empty"), SkillFailure, "no_points", "perception.look failed: empty"),
        (Rejected(reason="busy", detail="wait"), SkillRejected, "busy", "perception.look rejected: wait"),
        (Cancelled(), SkillFailure, "cancelled", "perception.look: it was cancelled"),
        (TimedOut(timeout_s=2.0), SkillFailure, "timed_out", "perception.look: it had not ended after 2 s"),
        (Unreachable(component="x"), SkillFailure, "unreachable", "perception.look: x does not answer"),
    ],
)
def test_any_other_outcome_raises_with_its_reason(
    outcome: Outcome[int], kind: type[SkillFailure | SkillRejected], reason: str, detail: str
) -> None:
    """A script decides by the reason."""
    with pytest.raises(kind) as raised:
        outcome.unwrap("perception.look")
    assert raised.value.reason == reason
    assert raised.value.detail.startswith(detail)
