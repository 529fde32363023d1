"""Settings of the shape task."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """When to stop, and how to look."""

    threshold_m: float = 0.012
    """RMSE below which the goal counts as reached [m] (the paper's 1.2 cm)."""
    max_actions: int = 40
    """Action budget: grasp-to-release cycles after which the task ends with outcome `budget`."""
    max_time_s: float = 1800.0
    """Time budget on the cell's clock [s]; the task ends with outcome `budget` when it is spent."""
    stall_actions: int = 15
    """Actions without a new best RMSE after which the task ends with outcome `stalled`."""
    changed_m: float = 0.0005
    """Change of the RMSE [m] below which an action has changed nothing: its node is marked (Fig. 6)."""
    settled_m: float = 0.0015
    """Two looks in a row that differ by less than this (RMS over nodes) [m]: the estimate has settled."""
    max_looks: int = 6
    """Looks after an action, at most."""
    look_interval_s: float = 0.15
    """Time between two of them [s]."""
    look_timeout_s: float = 20.0
    """Longest wait for the model's state after a look [s]."""
    max_recoveries: int = 5
    """Times that an arm which braked by itself (a sign of life came late) is cleared and the task goes on."""
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
