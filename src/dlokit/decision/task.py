"""What a shape task knows while it runs, and what it leaves behind."""

from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dlokit.communication.port import Port
from dlokit.decision.config import TaskConfig
from dlokit.geometry import rmse_m
from dlokit.types.action import Action, Correction
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, DloState, GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import OperatorCommand, RunOutcome
from dlokit.types.image import CameraCheck
from dlokit.types.message import Value
from dlokit.types.robot import FIRST_ROBOT, RobotState


@dataclass(frozen=True, kw_only=True)
class FailedPair:
    """A grasp that led to nothing from a shape."""

    node: int
    nodes_world: Float64Array  # (M, 3) [m]


def still_marked(pairs: Sequence[FailedPair], nodes_world: Float64Array, alike_m: float) -> list[FailedPair]:
    """The pairs whose shape is nearer than `alike_m` (RMSE) [m] to the present one (M, 3) [m]; with 0 none is."""
    return [pair for pair in pairs if rmse_m(pair.nodes_world, nodes_world) < alike_m]


class Odometer:
    """Adds up the way of every robot's tool centre point, sample by sample."""

    def __init__(self) -> None:
        self._last: dict[str, Float64Array] = {}
        self.travelled_m = 0.0
        """Of all tools together [m]; what is shorter than a sample apart is cut, a few millimetres in a metre."""

    async def follow(self, states: AsyncIterator[RobotState]) -> None:
        """Count for as long as there are states."""
        async for state in states:
            self.put(state)

    def put(self, state: RobotState) -> None:
        """Count the way from the robot's last state to this one."""
        here = state.T_world_tcp.position_m
        last = self._last.get(state.robot)
        if last is not None:
            self.travelled_m += float(np.linalg.norm(here - last))
        self._last[state.robot] = here


_SLIPS_ENOUGH = 2


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
    release_stamp_ns: int
    """When the fingers opened [ns]."""
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


@dataclass(kw_only=True)
class ShapeTask:
    """The state of a running task; the steps of the flow read and write it, nobody else."""

    port: Port
    config: TaskConfig
    request: GoalRequest | None
    """None: the operator sets the goal in the viewer."""
    stopwatch: Callable[[], float]
    """The machine's monotonic clock [s], for timings alone."""
    states: AsyncIterator[DloState]
    commands: AsyncIterator[OperatorCommand]
    odometer: Odometer
    recorded: Callable[[ActionRecord], None]
    """Told of every action when its effect is known."""
    robots: tuple[str, ...] = (FIRST_ROBOT,)
    """Names of the arms."""
    started_ns: int = 0

    camera: CameraReport | None = None
    goal: GoalShape | None = None
    asked: GoalShape | None = None
    """The goal that was asked for, when another one that holds took its place."""
    verdict: GoalVerdict | None = None
    state: DloState | None = None
    start: DloState | None = None
    errors_m: list[float] = field(default_factory=list[float])
    marks: list[FailedPair] = field(default_factory=list[FailedPair])
    action: Action | None = None
    action_started_ns: int = 0
    robot_started_ns: int = 0
    """When the action under way was chosen [ns]."""
    tool_started_m: float = 0.0
    """What the tool had travelled by then [m]."""
    decision_time_s: float = 0.0
    """What choosing it took, on the machine's clock [s]."""
    before_world: Float64Array | None = None
    """The shape (M, 3) [m] that the action under way was chosen for."""
    release_stamp_ns: int = 0
    grasp_ok: bool = False
    pushed: bool = False
    """Whether closed fingers have pushed the DLO in the action under way."""
    slipped: bool = False
    """Whether the DLO slipped out of the gripper in the action under way."""
    ended_by: str = ""
    """What ended the action under way before its planned end, as in its record."""
    belief: DloBelief | None = None
    """What was learnt of the DLO so far."""
    slips: dict[int, int] = field(default_factory=dict[int, int])
    """Grasp node → how often it slipped out there."""
    corrections: list[Correction] = field(default_factory=list[Correction])
    """Since the grasp."""
    corrections_seen: list[CorrectionRecord] = field(default_factory=list[CorrectionRecord])
    control_end: str = ""
    controlled: bool = False
    """Whether control follows the action under way."""
    deadlock: bool = False
    """Whether control of the action under way ended in a deadlock."""
    history: list[ActionRecord] = field(default_factory=list[ActionRecord])
    actions_before: int = 0
    """Actions of the run that this one resumes."""
    start_accepted: bool = False
    """Whether the run that this one resumes had begun from its start: an arm that then let go may have dropped the DLO
    across itself."""
    planning_time_s: float = 0.0
    recoveries: int = 0
    lost: str = ""
    """Component that did not answer the last call that failed; empty where that had another cause."""
    tracked_by: str = ""
    """The process of the observer that was told where the DLO lies: one that was started since knows nothing of it."""
    place_known_by: str = ""
    """The process of perception that was told where the camera stands, likewise; empty where nobody was, or where
    processes have no names."""
    restorations: int = 0
    """How often a component was lost and waited for."""
    reason: str | None = None

    @property
    def actions(self) -> int:
        """How many have ended, those of a run that this one resumes among them."""
        return self.actions_before + len(self.history)

    @property
    def watched(self) -> bool:
        """Whether the goal may not hold, so that the task must not go on for long without progress."""
        if self.verdict is None or self.asked is not None:
            return False
        return self.verdict.standing is not Standing.HOLDS

    @property
    def slippery(self) -> set[int]:
        """Nodes at which the DLO slipped out again after it had done so once: they are not grasped any more."""
        return {node for node, times in self.slips.items() if times >= _SLIPS_ENOUGH}

    @property
    def chosen(self) -> Action:
        """The action under way."""
        assert self.action is not None, "an action is chosen before the robot moves"
        return self.action

    @property
    def expected_world(self) -> Float64Array:
        """The shape (M, 3) [m] to expect after the action under way: predicted, or the one before it."""
        assert self.before_world is not None, "an action is chosen for a shape"
        predicted = self.corrections[-1].predicted_world if self.corrections else self.chosen.predicted_nodes_world
        moved = self.pushed or (self.grasp_ok and not self.slipped)
        return predicted if moved and predicted is not None else self.before_world
