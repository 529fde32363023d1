"""When a shape task is over: the paper's threshold, and the break conditions that it lacks."""

import enum
from collections.abc import Sequence

from dlokit.decision.config import TaskConfig


class Progress(enum.Enum):
    """What the errors so far say."""

    CONVERGED = "converged"
    NOT_YET = "not_yet"
    OUT_OF_ACTIONS = "out_of_actions"
    OUT_OF_TIME = "out_of_time"
    STALLED = "stalled"


def progress(errors_m: Sequence[float], elapsed_s: float, config: TaskConfig) -> Progress:
    """Judge a task by its RMSE before the first action and after each [m], and by its age on the cell's clock.

    Stalled means: none of the last ``stall_actions`` actions brought a new best.
    """
    if errors_m[-1] < config.threshold_m:
        return Progress.CONVERGED
    if len(errors_m) - 1 >= config.max_actions:
        return Progress.OUT_OF_ACTIONS
    if elapsed_s >= config.max_time_s:
        return Progress.OUT_OF_TIME
    best = min(range(len(errors_m)), key=errors_m.__getitem__)
    if len(errors_m) - 1 - best >= config.stall_actions:
        return Progress.STALLED
    return Progress.NOT_YET


def has_changed(before_m: float, after_m: float, config: TaskConfig) -> bool:
    """Whether an action changed the error (Fig. 6: if not, its grasp point is marked)."""
    return abs(after_m - before_m) >= config.changed_m
