"""Text of a run for the terminal and the report: its outcome in sentences, and the columns of its actions."""

import enum
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median

from dlokit.system.results.run_result import ActionResult, RunResult, VerdictResult
from dlokit.types.action import KINDS, facts_of
from dlokit.types.flow import RunOutcome
from dlokit.types.passing import TURNS, Passing

MEANINGS: Mapping[RunOutcome, str] = {
    RunOutcome.CONVERGED: "The DLO has reached the goal shape.",
    RunOutcome.STALLED: "Further actions did not reduce the error to the goal.",
    RunOutcome.INFEASIBLE: "The goal cannot be reached from here, or no grasp was possible.",
    RunOutcome.BUDGET: "The task used up its actions or its time before it reached the goal.",
    RunOutcome.DRY_RUN: "A dry run: no arm has moved.",
    RunOutcome.CANCELLED: "The task was stopped before its end.",
    RunOutcome.FAILED: "The task could not recover from an error.",
}


_TWIN = " A twin run: camera, DLO and the feedback of the fingers were simulated."

ANOTHER_DLO_M = 0.02
"""Median prediction error above which the configured model probably describes another DLO [m]."""


NONE = "–"


def millimetres(value_m: float | None) -> str:
    """A length [m] in millimetres; a dash for None."""
    return NONE if value_m is None else f"{value_m * 1000:.1f} mm"


def seconds(value_s: float | None) -> str:
    """A duration [s] with one decimal; a dash for None."""
    return NONE if value_s is None else f"{value_s:.1f} s"


def explain_outcome(result: RunResult, *, figures: bool = True) -> str:
    """Explain the outcome in a few sentences: the reason, the remaining error, and what may help.

    Without `figures` the sentence with the error and the number of actions is omitted, for pages that show both.
    """
    words = MEANINGS[result.outcome] + (_TWIN if result.twin else "")
    if result.reason and result.reason not in words:
        words += f" Reason: {result.reason.replace('_', ' ').rstrip('.')}."
    if result.rmse_m is None:
        # The goal is judged before its distance to the DLO is measured; a run may be stopped at any time.
        if result.goal_verdict is not None or result.outcome is RunOutcome.CANCELLED:
            return words
        return f"{words} The DLO was never observed."
    words += _instead(result.goal_verdict)
    if figures:
        words += _figures(result.rmse_m, result)
    return f"{words}{_sides(result.passing)}{_another_dlo(result)}"


def _figures(rmse_m: float, result: RunResult) -> str:
    relation = "below" if rmse_m < result.threshold_m else "above"
    threshold = f"{relation} the threshold of {result.threshold_m * 1000:.4g} mm"
    if result.unfinished:
        return (
            f" It ended during action {result.actions}; before that action, the nodes of the DLO were "
            f"{millimetres(rmse_m)} from their goals (RMSE), {threshold}."
        )
    return (
        f" Its nodes are {millimetres(rmse_m)} from their goals (RMSE), {threshold}, after {result.actions} "
        f"{'action' if result.actions == 1 else 'actions'}."
    )


def when_true(result: RunResult) -> str:
    """When the true error of a result was measured; empty where there is none, or none of a released DLO."""
    if result.true_rmse_m is None:
        return ""
    if any(row.true_rmse_m is not None for row in result.history):
        before = f", before action {result.actions}, which was not finished" if result.unfinished else ""
        return f"2 s after the last release{before}"
    # During an action the gripper may hold the DLO.
    return "" if result.unfinished else "at the end"


def _sides(found: Passing | None) -> str:
    """A sentence on the sides of the posts that were named; empty without a wish."""
    if found is None or not found.answers:
        return ""
    passed = ", ".join(f"{one.name} {TURNS[one.turn]}" for one in found.answers)
    return f" Not as wished: {found.why}." if found.why else f" It passes {passed}, as wished."


def _another_dlo(result: RunResult) -> str:
    """A hint for a run that did not converge and whose actions differed from the model's predictions."""
    errors_m = [
        row.prediction_error_m for row in result.history if row.prediction_error_m is not None and _as_planned(row)
    ]
    if result.outcome is RunOutcome.CONVERGED or len(errors_m) < 2 or median(errors_m) < ANOTHER_DLO_M:
        return ""
    return (
        f" Its actions ended {median(errors_m) * 1000:.0f} mm (median) from their predictions, so the configuration "
        "probably describes another DLO. `--learn` learns it while shaping, `dlokit identify` from this run."
    )


def _as_planned(row: ActionResult) -> bool:
    return row.grasp_ok and not row.slipped and row.ended_by is None


def _instead(verdict: VerdictResult | None) -> str:
    """A sentence for a run that pursued another goal than the requested one."""
    if verdict is None or not verdict.projected or verdict.asked_rmse_m is None:
        return ""
    return (
        f" It pursued the nearest feasible shape; the DLO is {millimetres(verdict.asked_rmse_m)} (RMSE) from the "
        "requested goal."
    )


def explain_recoveries(result: RunResult) -> str:
    """Number of recoveries of arms that had stopped on their own, by reason; empty without recoveries."""
    counted = Counter(one.reason for one in result.recoveries)
    return ", ".join(f"{reason} {number} {'time' if number == 1 else 'times'}" for reason, number in counted.items())


def grip_text(row: ActionResult) -> str:
    """The result of an action's grasp: held, not held, pushed, or the cause of an early end, e.g. slipped."""
    if row.ended_by is not None:
        return row.ended_by.replace("_", " ")
    if not facts_of(row.kind).grasps:
        return "pushed"
    if row.slipped:
        return "slipped"
    return "held" if row.grasp_ok else "not held"


class Tone(enum.Enum):
    """Emphasis of an entry."""

    NONE = ""
    GOOD = "good"
    BAD = "no"


@dataclass(frozen=True, kw_only=True)
class ActionColumn:
    """One column of the table of actions."""

    heading: str
    """Heading on the report's page."""
    text: Callable[[ActionResult], str]
    terminal: str = ""
    """Heading in the terminal, with ``{}`` for the threshold; empty: the column is on the page only."""
    narrow: str = ""
    """Heading in a narrow terminal, if it differs."""
    is_text: bool = False
    """Whether the entries are words, aligned to the left; numbers are aligned to the right."""
    least_width: int = 0
    """Minimum width [characters], so that the table keeps its width when another entry is added."""
    tone: Callable[[ActionResult, float], Tone] = lambda row, threshold_m: Tone.NONE
    """(action, threshold [m]) → emphasis of the entry."""
    of_all: bool = True
    """Whether every action has an entry; the terminal shows other columns only if at least one action has one."""

    def has(self, row: ActionResult) -> bool:
        """Whether an action has an entry."""
        return self.text(row) != NONE


ACTION_COLUMNS = (
    ActionColumn(heading="action", terminal="action", narrow="#", text=lambda row: str(row.action)),
    ActionColumn(
        heading="kind", terminal="kind", text=lambda row: row.kind, is_text=True, least_width=max(map(len, KINDS))
    ),
    ActionColumn(heading="grasp node", terminal="node", text=lambda row: str(row.grasp_node)),
    ActionColumn(
        heading="grasp",
        terminal="grasp",
        text=grip_text,
        is_text=True,
        tone=lambda row, threshold_m: Tone.NONE if grip_text(row) in ("held", "pushed") else Tone.BAD,
    ),
    ActionColumn(heading="expected RMSE", text=lambda row: millimetres(row.predicted_rmse_m)),
    ActionColumn(
        heading="RMSE after",
        terminal="RMSE\n< {}",  # in two lines, so that the whole table fits into 80 columns
        text=lambda row: millimetres(row.rmse_m),
        tone=lambda row, threshold_m: Tone.GOOD if row.rmse_m < threshold_m else Tone.NONE,
    ),
    ActionColumn(
        heading="true RMSE after", terminal="true\nRMSE", text=lambda row: millimetres(row.true_rmse_m), of_all=False
    ),
    ActionColumn(heading="duration", terminal="duration", narrow="time", text=lambda row: seconds(row.duration_s)),
)
"""The columns of the table of actions, in the terminal and on the report's page."""
