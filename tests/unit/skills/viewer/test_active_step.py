from dlokit.skills.viewer.state import ActiveStep
from dlokit.types.flow import FlowStatus, RunOutcome


def test_the_last_step_stays_highlighted_when_the_flow_ends() -> None:
    active = ActiveStep((("look", "seen", "compare"), ("compare", "out_of_actions", "budget_spent")))
    assert active.step == ""
    active.record(FlowStatus(stamp_ns=1, flow="shape", step="budget_spent", last_outcome="out_of_actions"))
    active.record(FlowStatus(stamp_ns=2, flow="shape", step="budget", outcome=RunOutcome.BUDGET))
    assert (active.step, active.last_outcome) == ("budget_spent", "out_of_actions")
