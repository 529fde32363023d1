"""Where the decision layer is, as everybody may see it."""

import enum

from dlokit.types.message import Message, Value


class RunOutcome(enum.Enum):
    """How a shape task ended."""

    CONVERGED = "converged"
    STALLED = "stalled"
    INFEASIBLE = "infeasible"
    BUDGET = "budget"
    CANCELLED = "cancelled"
    FAILED = "failed"


class Mode(enum.Enum):
    """How the shape is being changed."""

    PLANNING = "planning"
    """By an action that is planned from its grasp to its release."""
    CONTROL = "control"
    """By corrections of a DLO that is held, each from a new look."""


class FlowStatus(Message, frozen=True, kw_only=True, eq=False):
    """The step of the flow chart that runs now, and the last outcome."""

    flow: str
    step: str
    last_outcome: str = ""
    """Outcome that led here; empty at the start."""
    actions: int = 0
    rmse_m: float | None = None
    text: str = ""
    """One line for people."""
    outcome: RunOutcome | None = None
    """Set once, when the flow has ended."""
    mode: Mode | None = None
    """None in boxes that belong to neither, e.g. while the camera looks."""


class OperatorCommand(Message, frozen=True, kw_only=True, eq=False):
    """What the operator asks for in the viewer."""

    command: "Command"


class Command(enum.Enum):
    """The operator's buttons."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"


class GoalFrames(Message, frozen=True, kw_only=True, eq=False):
    """The paper's three movable frames, as the operator drags them."""

    frames: "tuple[GoalFrame, ...]"


class GoalFrame(Value, frozen=True, kw_only=True, eq=False):
    """One movable frame, pulling one node of the goal rod by a spring force."""

    node: int
    x_m: float
    y_m: float
    yaw_rad: float | None = None
    """Direction of the rod there in the table plane [rad]; None leaves it free."""
