"""What is measured of one run, beside what its result says already."""

from collections.abc import Sequence

from dlokit.decision.convergence import CHANGED_M
from dlokit.system.results.run_result import RunResult
from dlokit.types.feasibility import Standing
from dlokit.types.flow import RunOutcome

FALSE_BEYOND_M = 0.002
"""A run that reports convergence is wrong when the truth is beyond its threshold by more than this [m]."""
HOPELESS_ACTIONS = 3
"""A hopeless run must not go on for more actions than this without progress."""


def converged(run: RunResult) -> bool:
    """Whether it ended by reaching the goal that was asked for, by its own estimate."""
    verdict = run.goal_verdict
    return run.outcome is RunOutcome.CONVERGED and not (verdict is not None and verdict.projected)


def falsely_converged(run: RunResult) -> bool:
    """Whether it reports an error below the threshold, and the truth is beyond the threshold and a margin."""
    if run.outcome is not RunOutcome.CONVERGED or run.true_rmse_m is None:
        return False
    return run.true_rmse_m > run.threshold_m + FALSE_BEYOND_M


def reached(run: RunResult) -> bool:
    """Whether the goal that was asked for was reached in truth."""
    return converged(run) and not falsely_converged(run)


def standing(run: RunResult) -> Standing | None:
    """What was said of the goal; None when the run ended before it was judged."""
    return None if run.goal_verdict is None else run.goal_verdict.standing


def robot_time_s(run: RunResult) -> float:
    """Time that the robot was at work [s], on the cell's clock."""
    return sum(action.robot_time_s for action in run.history)


def path_length_m(run: RunResult) -> float:
    """What the tool travelled [m]."""
    return sum(action.path_length_m for action in run.history)


def is_hopeless(run: RunResult) -> bool:
    """Whether it was tried though the goal may not hold, and did not get there."""
    said = standing(run)
    return said is not None and said is not Standing.HOLDS and run.outcome is not RunOutcome.CONVERGED


def idle_actions(run: RunResult) -> int:
    """Actions at its end that brought no new best error, better by what the task takes for a change."""
    errors = [row.rmse_m for row in run.history]
    if run.start_rmse_m is not None:
        errors.insert(0, run.start_rmse_m)
    if not errors:
        return 0
    return len(errors) - 1 - _last_progress(errors, CHANGED_M)


def _last_progress(errors_m: Sequence[float], changed_m: float) -> int:
    best_m, last = errors_m[0], 0
    for number, error_m in enumerate(errors_m):
        if error_m < best_m - changed_m:
            best_m, last = error_m, number
    return last
