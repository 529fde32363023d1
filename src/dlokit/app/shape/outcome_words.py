"""What a run's outcome means, in words, for the terminal and the report."""

from collections.abc import Mapping
from statistics import median

from dlokit.system.results.run_result import ActionResult, RunResult, VerdictResult
from dlokit.types.flow import RunOutcome

MEANINGS: Mapping[RunOutcome, str] = {
    RunOutcome.CONVERGED: "The DLO has the shape that was asked for.",
    RunOutcome.STALLED: "Further actions did not bring the DLO nearer to the goal.",
    RunOutcome.INFEASIBLE: "The goal cannot be reached from here, or no grasp was possible.",
    RunOutcome.BUDGET: "What was allowed (actions, time) was used up before the goal was reached.",
    RunOutcome.CANCELLED: "The run was stopped before its end.",
    RunOutcome.FAILED: "Something went wrong that the run could not recover from.",
}


ANOTHER_DLO_M = 0.02
"""Actions that miss what was predicted by more than this, in the median, were predicted of another DLO."""


def outcome_in_words(result: RunResult) -> str:
    """A few sentences: what became of the run, why, how near the DLO came, and what may help."""
    words = MEANINGS[result.outcome]
    if result.reason and result.reason not in words:
        words += f" Reason: {result.reason.replace('_', ' ').rstrip('.')}."
    if result.rmse_m is None:
        # The goal is judged before the DLO is measured against it.
        return words if result.goal_verdict is not None else f"{words} The DLO was never seen."
    words += _instead(result.goal_verdict)
    relation = "below" if result.rmse_m < result.threshold_m else "above"
    return (
        f"{words} Its nodes are {result.rmse_m * 1000:.1f} mm from their goals (RMSE), {relation} the threshold of "
        f"{result.threshold_m * 1000:.4g} mm, after {result.actions} {'action' if result.actions == 1 else 'actions'}."
        f"{_another_dlo(result)}"
    )


def _another_dlo(result: RunResult) -> str:
    """A sentence when the run did not converge, and its actions did not do what the model of the DLO promised."""
    missed_m = [row.missed_m for row in result.history if row.missed_m is not None and _as_planned(row)]
    if result.outcome is RunOutcome.CONVERGED or len(missed_m) < 2 or median(missed_m) < ANOTHER_DLO_M:
        return ""
    return (
        f" Its actions ended {median(missed_m) * 1000:.0f} mm (median) from what was predicted: this is hardly the DLO "
        "that the configuration describes. `--learn` finds out while shaping, `dlokit identify` from this run."
    )


def _as_planned(row: ActionResult) -> bool:
    return row.grasp_ok and not row.slipped and row.ended_by is None


def _instead(verdict: VerdictResult | None) -> str:
    """A sentence when the run went for another goal than the one that was asked for."""
    if verdict is None or not verdict.projected or verdict.asked_rmse_m is None:
        return ""
    return (
        f" It went for the nearest shape that holds; the DLO is {verdict.asked_rmse_m * 1000:.1f} mm (RMSE) from the "
        "goal that was asked for."
    )
