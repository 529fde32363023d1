"""Settings of the shape task."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro
from msgspec import Meta

from dlokit.ranges import Count, Positive, check_ranges

LARGEST_THRESHOLD_M = 0.1
"""A larger threshold is a mistake: it is a quarter of the table, and most likely given in another unit."""
Infeasible = Literal["reject", "project", "try"]


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """When a task ends, and which optional steps it includes."""

    # Used so often that the command line also takes them without the prefix `task.`.
    threshold_m: Annotated[float, Meta(gt=0.0, le=LARGEST_THRESHOLD_M), tyro.conf.arg(aliases=("--threshold-m",))] = (
        0.012
    )
    """RMSE below which the goal counts as reached [m]; the paper's is 1.2 cm. Smaller: more precise, more actions."""
    max_actions: Annotated[Count, tyro.conf.arg(aliases=("--max-actions",))] = 40
    """Most actions of a task; then it ends as `budget`. An action is a grasp, a motion with it, and a release."""
    check_camera: Annotated[bool, tyro.conf.arg(aliases=("--check-camera",))] = True
    """Look at the robot's hand first, to correct the camera's position. It is corrected along the table."""
    max_time_s: Positive = 1800.0
    """Most time on the run's clock [s]; then the task ends as `budget`."""
    stall_actions: Count = 6
    """Actions without a new best RMSE after which the task ends as `stalled`. Larger: more patient."""
    watched_stall_actions: Count = 3
    """The same for a goal that may not hold: the verdict on it is doubtful, or infeasible with `--infeasible try`."""
    no_progress_actions: Count = 3
    """The same, if the planner also predicts no new best RMSE for its next action."""
    control: Annotated[bool, tyro.conf.arg(aliases=("--control",))] = False
    """Shape servoing: reduce the error in closed loop while the DLO is held. It follows a carry when it is predicted to
    reduce the error by more than the uncertainty of the observed shape; decided for each action before the arm
    moves."""
    learn: Annotated[bool, tyro.conf.arg(aliases=("--learn",))] = False
    """Learn stiffness, friction and set of the DLO from its actions. The next actions are planned with them."""
    infeasible: Annotated[Infeasible, tyro.conf.arg(aliases=("--infeasible",))] = "reject"
    """With a goal that cannot hold: reject, project or try. The same with one out of the arm's reach.
    reject: end, or ask the operator again, and give the nearest shape that holds. project: shape to that one instead.
    try: go on with the goal as it is."""
    grasp_force_n: Positive = 20.0
    """Grip force [N]. Larger: the DLO slips less and is squeezed more."""

    def __post_init__(self) -> None:
        check_ranges(self, "task")
