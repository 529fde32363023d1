"""What a run's outcome means, in words, for the terminal and the report."""

from collections.abc import Mapping

from dlokit.system.goal_result import VerdictResult
from dlokit.system.run_result import RunResult
from dlokit.types.flow import RunOutcome

MEANINGS: Mapping[RunOutcome, str] = {
    RunOutcome.CONVERGED: "The rope has the shape that was asked for.",
    RunOutcome.STALLED: "Further actions did not bring the rope nearer to the goal.",
    RunOutcome.INFEASIBLE: "The goal cannot be reached from here, or no grasp was possible.",
    RunOutcome.BUDGET: "The actions or the time allowed were used up before the goal was reached.",
    RunOutcome.CANCELLED: "The run was stopped by the operator.",
    RunOutcome.FAILED: "Something went wrong that the run could not recover from.",
}


def outcome_in_words(result: RunResult) -> str:
    """One or two sentences: what became of the run, why, and how near the rope came."""
    words = MEANINGS[result.outcome]
    if result.reason and result.reason not in words:
        words += f" Reason: {result.reason.replace('_', ' ').rstrip('.')}."
    if result.rmse_m is None:
        # The goal is judged before the rope is measured against it.
        return words if result.goal_verdict is not None else f"{words} The rope was never seen."
    words += _instead(result.goal_verdict)
    relation = "below" if result.rmse_m < result.threshold_m else "above"
    return (
        f"{words} Its nodes are {result.rmse_m * 1000:.1f} mm from their goals (RMSE), {relation} the threshold of "
        f"{result.threshold_m * 1000:.4g} mm, after {result.actions} {'action' if result.actions == 1 else 'actions'}."
    )


def _instead(verdict: VerdictResult | None) -> str:
    """A sentence when the run went for another goal than the one that was asked for."""
    if verdict is None or not verdict.projected or verdict.asked_rmse_m is None:
        return ""
    return (
        f" It went for the nearest shape that holds; the rope is {verdict.asked_rmse_m * 1000:.1f} mm (RMSE) from the "
        "goal that was asked for."
    )
