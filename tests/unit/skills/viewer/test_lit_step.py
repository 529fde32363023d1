from dlokit.skills.viewer.state import LitStep
from dlokit.types.flow import FlowStatus, RunOutcome


def test_the_last_step_stays_highlighted_when_the_flow_ends() -> None:
    lit = LitStep((("look", "seen", "compare"), ("compare", "out_of_actions", "budget_spent")))
    assert lit.step == ""
    lit.record(FlowStatus(stamp_ns=1, flow="shape", step="budget_spent", last_outcome="out_of_actions"))
    lit.record(FlowStatus(stamp_ns=2, flow="shape", step="budget", outcome=RunOutcome.BUDGET))
    assert (lit.step, lit.last_outcome) == ("budget_spent", "out_of_actions")
