"""Metrics of one run that its result does not contain."""

import math

from dlokit.decision.convergence import CHANGED_M
from dlokit.system.results.run_result import RunResult
from dlokit.types.feasibility import Standing
from dlokit.types.flow import RunOutcome

FALSE_MARGIN_M = 0.002
"""Margin above the threshold from which the ground truth contradicts a reported convergence [m]."""
NO_PROGRESS_ACTIONS = 3
"""Most actions without progress of a run without expected progress."""


def converged(run: RunResult) -> bool:
    """Whether the run ended by reaching the requested goal, by its own estimate."""
    verdict = run.goal_verdict
    return run.outcome is RunOutcome.CONVERGED and not (verdict is not None and verdict.projected)


def falsely_converged(run: RunResult) -> bool:
    """Whether it reports an error below the threshold, and the true error exceeds the threshold by a margin."""
    if run.outcome is not RunOutcome.CONVERGED or run.true_rmse_m is None:
        return False
    return run.true_rmse_m > run.threshold_m + FALSE_MARGIN_M


def reached(run: RunResult) -> bool:
    """Whether the requested goal was reached: truly, or by the run's own estimate where there is no truth."""
    return converged(run) and not falsely_converged(run)


def standing(run: RunResult) -> Standing | None:
    """The verdict on the goal; None when the run ended before it was judged."""
    return None if run.goal_verdict is None else run.goal_verdict.standing


def robot_time_s(run: RunResult) -> float:
    """Working time of the robot, on the cell's clock [s]."""
    return sum(action.robot_time_s for action in run.history)


def path_length_m(run: RunResult) -> float:
    """Distance travelled by the tool [m]."""
    return sum(action.path_length_m for action in run.history)


def is_without_progress(run: RunResult) -> bool:
    """Whether the run tried a possibly infeasible goal and did not reach it."""
    said = standing(run)
    return said is not None and said is not Standing.HOLDS and run.outcome is not RunOutcome.CONVERGED


def idle_actions(run: RunResult) -> int:
    """Number of final actions without a new best error that is better by at least the task's threshold of change."""
    errors = [row.rmse_m for row in run.history]
    if run.start_rmse_m is not None:
        errors.insert(0, run.start_rmse_m)
    best_m, idle = math.inf, 0
    for error_m in errors:
        idle += 1
        if error_m < best_m - CHANGED_M:
            best_m, idle = error_m, 0
    return idle
