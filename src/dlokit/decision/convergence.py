"""When a shape task is over: the paper's threshold, and the break conditions that it lacks."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass

from dlokit.decision.config import TaskConfig
from dlokit.decision.records import ActionRecord
from dlokit.geometry import rmse_m
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape

PROGRESS_M = 0.001
"""A new best RMSE is better than the previous best by at least this [m]: estimates of one shape differ by as much."""
CHANGED_M = 0.0005
"""An action that changes the RMSE by less than this [m] has changed nothing, and its node is marked (Fig. 6)."""


def error_m(nodes_world: Float64Array, goal: GoalShape) -> float:
    """RMSE of nodes (M, 3) [m] to the goal's, node by node [m]; of both orders where its ends can be exchanged."""
    return rmse_m(nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)


class Progress(enum.Enum):
    """Status of a task by its errors and budgets."""

    CONVERGED = "converged"
    NOT_YET = "not_yet"
    OUT_OF_ACTIONS = "out_of_actions"
    OUT_OF_TIME = "out_of_time"
    STALLED = "stalled"


@dataclass(frozen=True, kw_only=True)
class SoFar:
    """Errors, time and actions of a task so far: the input of the break conditions."""

    errors_m: Sequence[float]
    """RMSE before the first action and after each [m]."""
    elapsed_s: float = 0.0
    """On the run's clock [s]."""
    history: Sequence[ActionRecord] = ()
    """Actions of this run; of a resumed run only the errors are kept."""
    doubtful: bool = False
    """Whether the goal may not hold."""
    unmet: str = ""
    """What of the wish on posts is not met, or not seen to be; empty: nothing, or there is no wish."""


def progress(so_far: SoFar, config: TaskConfig) -> tuple[Progress, str | None]:
    """The first break condition that holds, and one sentence that explains why the task ends, or has not converged.

    Stalled means: the last ``stall_actions`` actions brought no new best that differs by `PROGRESS_M`; for a goal
    that may not hold, the last ``watched_stall_actions``.
    """
    errors_m, best = so_far.errors_m, best_so_far(so_far.errors_m, so_far.unmet)
    near = errors_m[-1] < config.threshold_m
    if near and not so_far.unmet:
        return Progress.CONVERGED, None
    if len(errors_m) - 1 >= config.max_actions:
        return Progress.OUT_OF_ACTIONS, f"{_counted(config.max_actions)} used; {best}"
    if so_far.elapsed_s >= config.max_time_s:
        return Progress.OUT_OF_TIME, f"{config.max_time_s:g} s are used; {best}"
    patience = min(config.stall_actions, config.watched_stall_actions) if so_far.doubtful else config.stall_actions
    if actions_without_progress(errors_m) >= patience:
        return Progress.STALLED, f"no better shape in {patience} actions; {best}"
    return Progress.NOT_YET, so_far.unmet if near else None


def actions_without_progress(errors_m: Sequence[float]) -> int:
    """Number of actions since the last new best RMSE, better by more than an estimate varies."""
    best_m, last = errors_m[0], 0
    for action, error_m in enumerate(errors_m):
        if error_m < best_m - PROGRESS_M:
            best_m, last = error_m, action
    return len(errors_m) - 1 - last


def worth_it(errors_m: Sequence[float], predicted_m: float | None, config: TaskConfig) -> bool:
    """Whether to execute an action with a predicted RMSE of `predicted_m` [m].

    Always, until ``no_progress_actions`` actions brought no new best; then only with a prediction of a new best, or
    from a planner that does not predict (None).
    """
    if predicted_m is None or actions_without_progress(errors_m) < config.no_progress_actions:
        return True
    return predicted_m < min(errors_m) - PROGRESS_M


def best_so_far(errors_m: Sequence[float], unmet: str = "") -> str:
    """The best RMSE, and the action after which it was reached, as text; with what is `unmet` now."""
    best_m = min(errors_m)
    return f"best RMSE {best_m * 1e3:.1f} mm after action {errors_m.index(best_m)}{unmet and '; '}{unmet}"


def has_changed(before_m: float, after_m: float) -> bool:
    """Whether an action changed the error (Fig. 6: if not, its grasp point is marked)."""
    return abs(after_m - before_m) >= CHANGED_M


def _counted(actions: int) -> str:
    return "1 action is" if actions == 1 else f"{actions} actions are"
