"""Status of the decision layer, and the operator's commands."""

import enum

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value


class RunOutcome(enum.Enum):
    """Outcomes of a shape task."""

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
    """Modes in which the robot changes the shape."""

    PLANNING = "planning"
    """An action is planned from grasp to release."""
    CONTROL = "control"
    """A grasped DLO is corrected in steps, each after a new observation."""


class FlowStatus(Message, frozen=True, kw_only=True, eq=False):
    """The present step of the flow chart, and the outcome that led to it."""

    flow: str
    step: str
    last_outcome: str = ""
    """Outcome of the previous step; empty at the start."""
    actions: int = 0
    """Number of actions that have ended; with an `outcome`, also the one that this cut short."""
    rmse_m: float | None = None
    text: str = ""
    """One line for the user."""
    outcome: RunOutcome | None = None
    """Outcome of the task; set only when the flow has ended."""
    mode: Mode | None = None
    """None in steps outside both modes, e.g. perception."""


class RunPhase(enum.Enum):
    """Phase of a run, as its operator sees it."""

    STARTING = "starting"
    """The processes start; no task has begun."""
    LOOKING = "looking"
    """The camera looks at a shape that the operator shows as the goal."""
    WAITING = "waiting"
    """The operator sets the goal and starts the task; nothing moves."""
    RUNNING = "running"
    """A task runs."""
    PAUSED = "paused"
    """The task waits between two steps until the operator resumes it."""
    ASKING = "asking"
    """The task waits before a motion until the operator allows it."""
    FINISHING = "finishing"
    """A task has ended; its files are being written."""
    ENDED = "ended"
    """The task has ended, and the run takes no further task."""


class TaskEnd(Value, frozen=True, kw_only=True, eq=False):
    """End of a task of a run."""

    number: int
    """Number of the task in its run, counted from 1."""
    goal: str
    """Name of its goal."""
    outcome: RunOutcome
    text: str
    """The outcome in a few sentences."""
    actions: int
    """Number of actions that began."""
    rmse_m: float | None
    """Last RMSE to the goal [m]; None when the DLO was never seen."""
    threshold_m: float
    """RMSE below which the goal counted as reached [m]."""
    folder: str = ""
    """Folder of the run; empty where nothing was written."""
    files: tuple[str, ...] = ()
    """Files of the task, as paths in that folder."""


class RunStatus(Message, frozen=True, kw_only=True, eq=False):
    """Phase of a run, the answer that it waits for, and the end of its last task."""

    phase: RunPhase
    task: int = 0
    """Number of the task, counted from 1; 0 before the first."""
    stays: bool = False
    """Whether the run takes another goal after its task."""
    paused: bool = False
    """Whether the operator has paused the task; it waits before its next step."""
    stepwise: bool = False
    """Whether the task asks the operator before each motion."""
    asks: str = ""
    """The motion that the operator must allow, e.g. ``move above the grasp point``; empty: none."""
    notice: str = ""
    """Why the operator's last command had no effect; empty if it had one."""
    last: TaskEnd | None = None
    """The task that ended last."""


class OperatorCommand(Message, frozen=True, kw_only=True, eq=False):
    """Command of the operator in the viewer."""

    command: "Command"
    nodes_world: Float64Array | None = None  # (K, 3) [m]
    """With START: the goal. None: the goal of the frames, or the present one."""
    goal: str = ""
    """Name of that goal."""


class Command(enum.Enum):
    """Commands that the viewer sends."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    SEE = "see"
    """Look, and take the shape that the camera sees as the goal."""
    STEPWISE = "stepwise"
    """Ask before each motion from now on."""
    CONTINUOUS = "continuous"
    """Stop asking before motions."""
    PROCEED = "proceed"
    """Allow the motion that the task asks about."""
    END = "end"
    """End the run."""


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
