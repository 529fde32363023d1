"""Status of the decision layer, and the operator's commands."""

import enum

from dlokit.types.message import Message, Value


class RunOutcome(enum.Enum):
    """How a shape task ended."""

    CONVERGED = "converged"
    STALLED = "stalled"
    INFEASIBLE = "infeasible"
    BUDGET = "budget"
    CANCELLED = "cancelled"
    DRY_RUN = "dry_run"
    FAILED = "failed"

    @property
    def is_success(self) -> bool:
        """Whether the task ended as it was meant to: at its goal, or as a dry run at its end."""
        return self in (RunOutcome.CONVERGED, RunOutcome.DRY_RUN)


class Mode(enum.Enum):
    """How the robot changes the shape."""

    PLANNING = "planning"
    """By an action that is planned from grasp to release."""
    CONTROL = "control"
    """By corrections of a grasped DLO, each after a new observation."""


class FlowStatus(Message, frozen=True, kw_only=True, eq=False):
    """The present step of the flow chart, and the outcome that led to it."""

    flow: str
    step: str
    last_outcome: str = ""
    """Outcome of the previous step; empty at the start."""
    actions: int = 0
    rmse_m: float | None = None
    text: str = ""
    """One line for the user."""
    outcome: RunOutcome | None = None
    """Outcome of the task; set only when the flow has ended."""
    mode: Mode | None = None
    """None in steps that belong to neither mode, e.g. perception."""


class OperatorCommand(Message, frozen=True, kw_only=True, eq=False):
    """Command of the operator in the viewer."""

    command: "Command"


class Command(enum.Enum):
    """Buttons of the viewer."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"


class GoalFrames(Message, frozen=True, kw_only=True, eq=False):
    """The paper's three movable frames, as the operator drags them."""

    frames: "tuple[GoalFrame, ...]"


class GoalFrame(Value, frozen=True, kw_only=True, eq=False):
    """One movable frame, which pulls one node of the goal rod with a spring force."""

    node: int
    x_m: float
    y_m: float
    yaw_rad: float | None = None
    """Direction of the rod at the node in the table plane [rad]; None: free."""
