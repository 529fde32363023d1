"""What a shape task is asked for, and what it leaves behind."""

from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import RunOutcome
from dlokit.types.image import CameraCheck
from dlokit.types.message import Value


class GoalRequest(Value, frozen=True, kw_only=True, eq=False):
    """The goal as it was asked for."""

    nodes_world: Float64Array  # (K, 3) [m], any K >= 2
    name: str
    ends_interchangeable: bool = False


class CorrectionRecord(Value, frozen=True, kw_only=True, eq=False):
    """One correction while the DLO was held."""

    displacement: Float64Array  # (4,) x, y, z [m], yaw [rad] of the tool
    before_m: float
    """RMSE expected had the DLO been let go before it [m]."""
    predicted_m: float
    """RMSE that the model promised of it [m]."""
    seen_m: float | None
    """RMSE expected of letting go after it, from what the camera saw then [m]; None: nothing was seen."""


class ActionRecord(Value, frozen=True, kw_only=True, eq=False):
    """One grasp-to-release, and the shape after it."""

    action: int
    """Counted from 1."""
    kind: str
    """In words, as `types.action.kind_of` has it."""
    grasp_node: int
    grasp_ok: bool
    rmse_m: float
    predicted_rmse_m: float | None
    """Of the shape that was expected when the action was chosen [m]; None where none was predicted."""
    duration_s: float
    """From the decision to the next settled look, on the cell's clock [s]."""
    robot_time_s: float
    """From the decision until the arm is out of the picture again, on the cell's clock [s]."""
    path_length_m: float
    """What the tool travelled in that time [m]."""
    planning_time_s: float
    """What choosing it took, on the machine's clock [s]."""
    release_stamp_ns: int | None
    """When the fingers opened [ns]; None: they did not."""
    nodes_world: Float64Array  # (M, 3) [m] after it
    expected_world: Float64Array | None = None  # (M, 3) [m]
    """The shape that was expected when it was chosen; None where none was predicted."""
    path_world: Float64Array | None = None  # (W, 3) [m]
    """The tool's path as it was planned, from the grasp to the release."""
    slipped: bool = False
    """Whether the DLO slipped out of the gripper on the way."""
    corrections: tuple[CorrectionRecord, ...] = ()
    """What control did before the release."""
    control_end: str = ""
    """Why control ended, or did not begin, by name; empty where it was not asked for."""
    ended_by: str = ""
    """What ended the action before its planned end: ``slipped``, or the robot's reason, e.g. ``lease_lost``; empty: it
    came to that end."""


class CameraReport(Value, frozen=True, kw_only=True, eq=False):
    """What the look at the robot's own hand said of the camera."""

    text: str
    """For people, one sentence."""
    check: CameraCheck | None = None
    """By how much its place was corrected; None: it was not, the text says why."""


class StepVisit(Value, frozen=True, kw_only=True, eq=False):
    """How long one visit of one box took."""

    step: str
    cell_s: float
    """On the cell's clock [s]."""
    machine_s: float
    """On the machine's [s]."""


class ShapeResult(Value, frozen=True, kw_only=True, eq=False):
    """How a shape task ended."""

    outcome: RunOutcome
    reason: str | None
    """One sentence; None when converged."""
    rmse_m: float
    """Last RMSE of the model's state to the goal [m]; nan when the DLO was never seen."""
    best_rmse_m: float
    goal: GoalShape | None
    start_nodes_world: Float64Array | None  # (M, 3) [m] as first estimated
    start_stamp_ns: int
    """Stamp of the look that it comes from [ns]."""
    start_rmse_m: float | None
    history: tuple[ActionRecord, ...]
    verdict: GoalVerdict | None
    """On the goal that was asked for; None when the task ended before it was judged."""
    asked: GoalShape | None
    """The goal that was asked for, when another one that holds took its place."""
    asked_rmse_m: float | None
    """Last RMSE to that one [m]."""
    timings: tuple[StepVisit, ...]
    planning_time_s: float
    """On the machine's clock [s]."""
    camera: CameraReport | None = None
    """None: it was not checked."""
