"""The request of a shape task, and its records."""

from typing import NoReturn

import msgspec

from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import RunOutcome
from dlokit.types.image import CameraCheck
from dlokit.types.message import Value
from dlokit.types.passing import Passing, SideWish


class GoalRequest(Value, frozen=True, kw_only=True, eq=False):
    """A requested goal."""

    nodes_world: Float64Array  # (K, 3) [m], any K >= 2
    name: str
    ends_interchangeable: bool = False
    beside: tuple[SideWish, ...] | None = None
    """How the DLO is to pass posts, in their order along it; None: as configured for all goals."""

    @classmethod
    def of(cls, goal: GoalShape) -> "GoalRequest":
        """The request of a goal that is set."""
        return cls(
            nodes_world=goal.nodes_world,
            name=goal.name,
            ends_interchangeable=goal.ends_interchangeable,
            beside=goal.beside,
        )


class CorrectionRecord(Value, frozen=True, kw_only=True, eq=True, forbid_unknown_fields=False):
    """One small corrective motion of the tool while it held the DLO."""

    x_m: float
    """Translation of the tool, in the world frame [m]."""
    y_m: float
    z_m: float
    yaw_rad: float
    """Rotation about the vertical [rad]."""
    before_m: float
    """Expected error after a release before this correction [m]."""
    predicted_m: float
    """Predicted error after this correction [m]."""
    seen_m: float | None = None
    """Expected error after a release, from the observation after the correction [m]; None without an observation."""


class ActionFigures(Value, frozen=True, kw_only=True, eq=True, forbid_unknown_fields=False):
    """The figures of one action, from the grasp to the release.

    A new figure is a field here and a value in `attempt.record_of`: with that it is in `result.json`, in progress
    reports and in the recording.
    """

    action: int
    """Number of the action, from 1."""
    kind: str
    """Kind of action: pick-and-place, drag, lay-down, …"""
    grasp_node: int
    grasp_ok: bool
    """Whether the gripper held the DLO."""
    slipped: bool = False
    """Whether the DLO slipped out of the gripper during the motion."""
    rmse_m: float
    """Estimated error to the goal after the action [m]."""
    predicted_rmse_m: float | None = None
    """Expected error when the action was chosen [m]; None if the planner makes no prediction."""
    prediction_error_m: float | None = msgspec.field(default=None, name="missed_m")
    """RMS distance between the shape after the action and the predicted one [m]; None without a prediction. It is
    `missed_m` in `result.json`."""
    duration_s: float
    """Time from the choice of the grasp to the look after the release, on the run's clock [s]."""
    robot_time_s: float
    """Time from the choice of the grasp until the arm has left the view, on the run's clock [s]."""
    path_length_m: float
    """Distance travelled by the tool in that time [m]."""
    planning_time_s: float
    """Wall time spent choosing it [s]."""
    corrections: tuple[CorrectionRecord, ...] = ()
    """Corrections by closed-loop control before the release."""
    control_end: str | None = None
    """Why control ended, by name; not_worth_it if it was not chosen; None if it was not requested."""
    ended_by: str | None = None
    """Cause of an early end of the action: slipped, or the robot's reason (lease_lost, lost_commander, arms_too_near,
    …); None for a normal end."""

    @property
    def missed_m(self) -> NoReturn:
        """The earlier name of `prediction_error_m`. Raises `AttributeError`."""
        raise AttributeError("missed_m of an action is called prediction_error_m now")


class ActionRecord(ActionFigures, frozen=True, kw_only=True, eq=False, forbid_unknown_fields=True):
    """The figures and the shapes of one action."""

    release_stamp_ns: int | None
    """When the fingers opened [ns]; None: they did not."""
    nodes_world: Float64Array  # (M, 3) [m] after it
    expected_world: Float64Array | None = None  # (M, 3) [m]
    """The shape that was predicted when the action was chosen; None without a prediction."""
    path_world: Float64Array | None = None  # (W, 3) [m]
    """The planned path of the tool, from the grasp to the release."""


class CameraReport(Value, frozen=True, kw_only=True, eq=False):
    """Result of the camera check by a look at the robot's own hand."""

    text: str
    """For people, one sentence."""
    check: CameraCheck | None = None
    """The correction of the camera's position; None: it was not corrected, and `text` explains why."""


class Recovery(Value, frozen=True, kw_only=True, eq=True, forbid_unknown_fields=False):
    """One recovery of an arm that had stopped on its own."""

    action: int
    """The current action, counted from 1; before the first one, 1."""
    reason: str
    """The robot's reason: reflex, lease_lost, lost_commander, …"""


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
    """Stamp of the look at the start shape [ns]."""
    start_rmse_m: float | None
    history: tuple[ActionRecord, ...]
    unfinished: bool = False
    """Whether the task ended during an action, which is not in the history."""
    verdict: GoalVerdict | None
    """Verdict on the requested goal; None when the task ended before it was judged."""
    asked: GoalShape | None
    """The requested goal, if the nearest shape that holds has replaced it."""
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
    passing: Passing | None = None
    """How the DLO passes the fixtures at the end; None without fixtures."""
