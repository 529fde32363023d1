"""Settings of the shape task."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from dlokit.errors import ConfigError

LARGEST_THRESHOLD_M = 0.1
"""A larger threshold is not meant: it is a quarter of the table, and most likely given in another unit."""
Infeasible = Literal["reject", "project", "try"]


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """When to stop, and how to look."""

    # Asked for so often that the command line has them without the prefix `task.`.
    threshold_m: Annotated[float, tyro.conf.arg(prefix_name=False)] = 0.012
    """RMSE below which the goal counts as reached [m]; the paper's is 1.2 cm."""
    max_actions: Annotated[int, tyro.conf.arg(prefix_name=False)] = 40
    """Most actions; an action is a grasp, what is done with it, and a release. Then the task ends as `budget`."""
    check_camera: Annotated[bool, tyro.conf.arg(prefix_name=False)] = True
    """Look at the robot's hand first, to correct the camera's place; how far it is off along the table."""
    check_height_m: float = 0.15
    """Height of the tool centre point over the table while the hand is looked at [m]: clear of the DLO."""
    max_time_s: float = 1800.0
    """Time budget on the cell's clock [s]; the task ends with outcome `budget` when it is spent."""
    stall_actions: int = 6
    """Actions without a new best RMSE after which the task ends with outcome `stalled`."""
    watched_stall_actions: int = 3
    """The same for a goal that may not hold: the verdict on it was doubtful, or infeasible and it is tried all the
    same."""
    hopeless_actions: int = 3
    """The same where the planner expects no new best of its next action either."""
    progress_m: float = 0.001
    """A new best RMSE is one that is better by this [m]: what estimates of one shape differ by."""
    control: Annotated[bool, tyro.conf.arg(prefix_name=False)] = False
    """Shape servoing: reduce the error in closed loop while the DLO is held; after a carry, where it is expected to
    reduce more than the errors of looking amount to. Chosen for each action before the arm moves."""
    max_corrections: int = 4
    """Corrections of one grasp, at most."""
    alike_m: float = 0.002
    """A grasp that failed stays marked while the shape is nearer than this (RMSE) to the one from which it failed [m];
    0, as in the paper: any change of the error clears all marks."""
    learn: Annotated[bool, tyro.conf.arg(prefix_name=False)] = False
    """Learn stiffness, friction and set of the DLO from its actions; what was learnt is used to plan the next."""
    infeasible: Annotated[Infeasible, tyro.conf.arg(prefix_name=False)] = "reject"
    """What to do with a goal that cannot hold: reject, project or try; the same with one out of the arm's reach.
    reject: end, or ask the operator again, and say which is the nearest shape that holds. project: shape to that one
    instead. try: go on all the same."""
    changed_m: float = 0.0005
    """Change of the RMSE [m] below which an action has changed nothing: its node is marked (Fig. 6)."""
    settled_m: float = 0.0015
    """Two looks in a row that differ by less than this (RMS over nodes) [m]: the estimate has settled."""
    astray_m: float = 0.01
    """A model farther than this from a rod found anew (RMS over nodes) is put there instead of dragged [m]."""
    max_looks: int = 6
    """Looks after an action, at most."""
    look_interval_s: float = 0.15
    """Time between two of them [s]."""
    look_timeout_s: float = 20.0
    """Longest wait for the model's state after a look [s]."""
    look_again_s: float = 5.0
    """A look of which nothing came for so long is done again, as long as all are there [s]: a message was dropped."""
    max_recoveries: int = 5
    """Times that an arm which braked by itself (a sign of life came late) is cleared and the task goes on."""
    max_restorations: int = 4
    """Times that a component which was lost (its process died, or froze) is waited for, and the task goes on."""
    restart_timeout_s: float = 180.0
    """Longest wait for a process that is started again [s of the machine's clock]."""
    robot_timeout_s: float = 10.0
    """Longest wait for the robot's first state [s]."""
    tracking_hz: float = 2.0
    """Looks a second while the rod is carried [Hz]."""
    approach_height_m: float = 0.06
    """Height above the grasp where the joint-space move ends [m]."""
    retreat_height_m: float = 0.06
    """Height above the release where the gripper retreats to, straight up [m]."""
    grasp_force_n: float = 20.0
    """Grip force [N]."""
    settle_s: float = 0.5
    """Wait after the release before looking [s]."""

    def __post_init__(self) -> None:
        for name in ("max_actions", "stall_actions", "watched_stall_actions", "hopeless_actions", "max_looks"):
            count: int = getattr(self, name)
            if count < 1:
                raise ConfigError(f"{_flag(name)} is {count}; it must be 1 or more.")
        for name in (
            "threshold_m",
            "max_time_s",
            "look_timeout_s",
            "look_again_s",
            "robot_timeout_s",
            "restart_timeout_s",
            "grasp_force_n",
            "check_height_m",
        ):
            value: float = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"{_flag(name)} is {value}; it must be a number above 0.")
        if self.threshold_m > LARGEST_THRESHOLD_M:
            raise ConfigError(
                f"--threshold-m is {self.threshold_m}; it must be {LARGEST_THRESHOLD_M} or less. It is in metres: "
                "0.012 is 12 mm."
            )
        for name in (
            "changed_m",
            "progress_m",
            "max_corrections",
            "alike_m",
            "settled_m",
            "look_interval_s",
            "max_recoveries",
            "max_restorations",
            "tracking_hz",
            "approach_height_m",
            "retreat_height_m",
            "settle_s",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"{_flag(name)} is {value}; it must be a number, 0 or more.")


def _flag(name: str) -> str:
    prefix = "" if name in ("threshold_m", "max_actions") else "task."
    return f"--{prefix}{name.replace('_', '-')}"
