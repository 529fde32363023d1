"""The request of a shape task, and its records."""

from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import RunOutcome
from dlokit.types.image import CameraCheck
from dlokit.types.message import Value


class GoalRequest(Value, frozen=True, kw_only=True, eq=False):
    """A requested goal."""

    nodes_world: Float64Array  # (K, 3) [m], any K >= 2
    name: str
    ends_interchangeable: bool = False

    @classmethod
    def of(cls, goal: GoalShape) -> "GoalRequest":
        """The request of a goal that is set."""
        return cls(nodes_world=goal.nodes_world, name=goal.name, ends_interchangeable=goal.ends_interchangeable)


class CorrectionRecord(Value, frozen=True, kw_only=True, eq=False):
    """One correction while the DLO was held."""

    displacement: Float64Array  # (4,) x, y, z [m], yaw [rad] of the tool
    before_m: float
    """RMSE predicted for releasing the DLO before the correction [m]."""
    predicted_m: float
    """RMSE predicted for releasing it after the correction, before it was made [m]."""
    seen_m: float | None
    """The same from what the camera saw after the correction [m]; None: nothing was seen."""


class ActionRecord(Value, frozen=True, kw_only=True, eq=False):
    """One grasp-to-release, and the shape after it."""

    action: int
    """Counted from 1."""
    kind: str
    """Kind of action, as `types.action.kind_of` names it."""
    grasp_node: int
    grasp_ok: bool
    rmse_m: float
    predicted_rmse_m: float | None
    """RMSE of the shape that was predicted when the action was chosen [m]; None where none was."""
    duration_s: float
    """From the decision to the next settled look, on the run's clock [s]."""
    robot_time_s: float
    """From the decision until the arm is out of the picture again, on the run's clock [s]."""
    path_length_m: float
    """Distance that the tool travelled in that time [m]."""
    planning_time_s: float
    """Duration of the choice on the machine's clock [s]."""
    release_stamp_ns: int | None
    """When the fingers opened [ns]; None: they did not."""
    nodes_world: Float64Array  # (M, 3) [m] after it
    expected_world: Float64Array | None = None  # (M, 3) [m]
    """The shape that was predicted when the action was chosen; None where none was."""
    path_world: Float64Array | None = None  # (W, 3) [m]
    """The planned path of the tool, from the grasp to the release."""
    slipped: bool = False
    """Whether the DLO slipped out of the gripper during the carry."""
    corrections: tuple[CorrectionRecord, ...] = ()
    """Corrections made before the release."""
    control_end: str = ""
    """Name of the reason why control ended or did not begin; empty where it is off."""
    ended_by: str = ""
    """What ended the action before its planned end: ``slipped``, or the robot's reason, e.g. ``lease_lost``; empty: it
    reached that end."""


class CameraReport(Value, frozen=True, kw_only=True, eq=False):
    """Result of the camera check by a look at the robot's own hand."""

    text: str
    """For people, one sentence."""
    check: CameraCheck | None = None
    """The correction of the camera's position; None: it was not corrected, and `text` says why."""


class Recovery(Value, frozen=True, kw_only=True, eq=False):
    """One recovery of an arm that had stopped on its own."""

    action: int
    """The action under way, counted from 1; before the first one, 1."""
    reason: str
    """The robot's reason: ``reflex``, ``lease_lost``, …"""


class StepVisit(Value, frozen=True, kw_only=True, eq=False):
    """Duration of one visit of one step."""

    step: str
    cell_s: float
    """On the run's clock [s]."""
    machine_s: float
    """On the machine's clock [s]."""


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
    """Stamp of the look that gave the start [ns]."""
    start_rmse_m: float | None
    history: tuple[ActionRecord, ...]
    verdict: GoalVerdict | None
    """Verdict on the requested goal; None when the task ended before it was judged."""
    asked: GoalShape | None
    """The requested goal, where the nearest shape that holds has replaced it."""
    asked_rmse_m: float | None
    """Last RMSE to the requested goal [m]."""
    timings: tuple[StepVisit, ...]
    planning_time_s: float
    """On the machine's clock [s]."""
    camera: CameraReport | None = None
    """None: the camera was not checked."""
    interruptions: tuple[str, ...] = ()
    """Why the task looked again, each time it went on after a loss."""
    recoveries: tuple[Recovery, ...] = ()
    """Each time that an arm which had stopped on its own was recovered."""
