"""Actions from grasp to release, the candidates a planner considers, and the corrections of a grasped node."""

import enum
import math
from collections.abc import Mapping
from typing import ClassVar, get_args

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT

APPROACH_HEIGHT_M = 0.06
"""Height above a grasp where the joint-space move ends and the straight descent begins, and above a release where the
straight ascent ends [m]."""


class VelocityProfile(Value, frozen=True, kw_only=True, eq=False):
    """Speed, acceleration and jerk limits of the tool along a path; they can influence the resulting shape.

    Raises `BadValue` if one of the three is not a finite number above 0.
    """

    speed_m_s: float = 0.25
    acceleration_m_s2: float = 1.0
    jerk_m_s3: float = 10.0

    def __post_init__(self) -> None:
        for name, value, unit in (
            ("speed_m_s", self.speed_m_s, "m/s"),
            ("acceleration_m_s2", self.acceleration_m_s2, "m/s²"),
            ("jerk_m_s3", self.jerk_m_s3, "m/s³"),
        ):
            if not 0.0 < value < math.inf:
                raise BadValue(f"a velocity profile's {name} is {value}; give a finite number above 0 in {unit}")


class Grasp(Value, frozen=True, kw_only=True, eq=False):
    """Where and how to grasp the DLO."""

    node: int
    T_world_tcp: Pose
    """Pose of the tool centre point between the fingertips: x axis along the rod, z (approach) down."""
    opening_m: float = 0.04
    """Finger opening on approach [m]."""


class Partner(Value, frozen=True, kw_only=True, eq=False):
    """The second arm's part of an action."""

    robot: str
    grasp: Grasp
    path: tuple[Pose, ...]
    velocity: VelocityProfile
    """Profile with which both paths take the same time."""


class KindFacts(Value, frozen=True, kw_only=True):
    """What dlokit knows of a kind of action: its row of `KINDS`. All else about an action is in its fields."""

    does: str
    """What it does, for people, e.g. ``"Grasps a node and drags it over the table"``."""
    usual_error_m: float
    """How far the DLO usually ends from the predicted shape (RMS) [m]; the planner adds it to the score."""
    grasps: bool = True
    """Whether fingers hold the DLO; otherwise closed fingers descend beside it and push it. The flow chart carries a
    held DLO (step `move_to_goal`) and watches for a slip, or pushes it (step `push`); the planning rod is simulated
    with its node in the gripper, or with closed fingers that touch it."""
    lifts: bool = True
    """Whether it lifts the DLO off the table."""
    corrected: bool = True
    """Whether control may correct the DLO before the release (step `control`); for that, one arm must hold it."""
    drapes: bool = False
    """Whether the DLO must drape to follow the path: the error of a stiff one is larger."""
    short: str = ""
    """Name in narrow tables, if it has another."""


class ActionBase(Message, frozen=True, kw_only=True, eq=False):
    """Fields of every action: descend at a node, move along a path, ascend. The kinds differ in their paths."""

    facts: ClassVar[KindFacts]
    """What all actions of its kind have in common."""

    grasp: Grasp
    """Where the tool descends."""
    path: tuple[Pose, ...]
    """Tool poses from the grasp to the release, without the grasp pose."""
    velocity: VelocityProfile
    predicted_nodes_world: Float64Array | None = None  # (M, 3) [m] predicted shape after it; None: not predicted
    robot: str = FIRST_ROBOT
    """Name of the arm; planning replaces the default by the installed name."""
    partner: Partner | None = None
    """The second arm's part; only `PairPlace` has one."""


class PickPlace(ActionBase, frozen=True, kw_only=True, eq=False, tag="pick-and-place"):
    """Grasp a node, carry it along a path above the table, release it."""

    facts = KindFacts(
        does="Grasps a node, carries it above the table, and puts it down", usual_error_m=0.003, short="pick"
    )


class Drag(ActionBase, frozen=True, kw_only=True, eq=False, tag="drag"):
    """Grasp a node and drag it over the table, without lifting the rod."""

    facts = KindFacts(does="Grasps a node and drags it over the table", usual_error_m=0.0015, lifts=False)


class LayDown(ActionBase, frozen=True, kw_only=True, eq=False, tag="lay-down"):
    """Grasp near an end, lift most of the rod, and lay it down along a curve."""

    facts = KindFacts(
        does="Grasps near an end, lifts most of the DLO, and lays it down along a curve",
        usual_error_m=0.008,  # near the goal it is not worth its time
        drapes=True,
        short="lay",
    )


class Push(ActionBase, frozen=True, kw_only=True, eq=False, tag="push"):
    """Push the rod over the table with closed fingers that descend beside it; nothing is grasped.

    Its `grasp` is the pose where the fingers descend, with the pushed node and an opening of zero.
    """

    facts = KindFacts(
        does="Pushes the DLO over the table with closed fingers",
        usual_error_m=0.005,
        grasps=False,
        lifts=False,
        corrected=False,
    )


class PairPlace(ActionBase, frozen=True, kw_only=True, eq=False, tag="pair"):
    """Two arms each grasp a node, carry both at the same time, and release both.

    All fields but `partner` describe the first arm's part.
    """

    facts = KindFacts(
        does="Two arms each grasp a node, and carry both at the same time", usual_error_m=0.003, corrected=False
    )


Action = PickPlace | Drag | LayDown | Push | PairPlace
"""Union of all kinds of actions."""


def kind_of(action: Action | type[Action]) -> str:
    """Name of an action's kind, e.g. ``"pick-and-place"``."""
    return str(action.__struct_config__.tag)


KINDS: Mapping[str, KindFacts] = {kind_of(kind): kind.facts for kind in get_args(Action)}
"""The table of the kinds of action: name → facts. A new kind is a class above and a member of `Action`; see
docs/how-to/add-a-kind-of-action.md."""


def facts_of(kind: str) -> KindFacts:
    """Facts of the kind with this name; those of a pick-and-place for a name from another version of dlokit."""
    return KINDS.get(kind, PickPlace.facts)


class Marks(Value, frozen=True, kw_only=True, eq=False):
    """Grasp nodes marked as tried without effect since the shape last changed (Fig. 6)."""

    invalid_nodes: Int64Array  # (n,)


class ScoredCandidate(Value, frozen=True, kw_only=True, eq=False):
    """One candidate action with its score."""

    kind: str
    """Name of its kind, as from `kind_of`."""
    node: int
    """Node to be grasped or pushed."""
    score_m: float
    """Remaining error after it, as the planner scores it [m]; lower is better."""
    nodes_world: Float64Array  # (M, 3) [m] predicted shape after it
    path_world: Float64Array  # (W, 3) [m] path of the tool


class Candidates(Message, frozen=True, kw_only=True, eq=False):
    """Progress of a planner: the number of simulated candidates, and the best of them."""

    rollouts: int
    """Number of candidates simulated so far."""
    budget: int
    """Largest number of candidates to simulate."""
    best: tuple[ScoredCandidate, ...] = ()
    """The best candidates, best first."""


class GraspedNode(Value, frozen=True, kw_only=True, eq=False):
    """A node that a gripper holds."""

    node: int
    T_world_tcp: Pose
    """Pose of the tool that holds it."""


class Correction(Value, frozen=True, kw_only=True, eq=False):
    """A small motion of the tool that holds the DLO, with the model's predictions."""

    displacement: Float64Array  # (4,) x, y, z [m] and yaw [rad] of the tool, in the world
    released_world: Float64Array  # (M, 3) [m] predicted shape if the DLO is released before it
    predicted_world: Float64Array  # (M, 3) [m] predicted shape if the DLO is released after it


class ControlForecast(Value, frozen=True, kw_only=True):
    """Whether control should follow an action, predicted before the action."""

    follows: bool
    gain_m: float
    """Reduction of the RMSE expected from control [m]; changes within the observer's uncertainty do not count."""


class ControlVerdict(enum.Enum):
    """Whether control can still reduce the error to the goal."""

    CORRECT = "correct"
    """It can: execute the correction, then observe the shape again."""
    SETTLED = "settled"
    """The shape is good enough, or this grasp cannot improve it much: release."""
    DEADLOCK = "deadlock"
    """The error is not small and control cannot reduce it: release, and plan another grasp."""


class ControlAdvice(Value, frozen=True, kw_only=True, eq=False):
    """Next step of control for a grasped DLO."""

    verdict: ControlVerdict
    reason: str
    """Name of the reason to stop: good_enough, no_gain, in_doubt, badly_seen; no_progress, overstretch, out_of_reach,
    no_room. Empty for a correction."""
    rmse_m: float
    """Predicted error to the goal if the DLO is released now [m]."""
    then_rmse_m: float
    """Predicted error if the DLO is released after the correction [m]; equal to `rmse_m` without a correction."""
    target: Pose
    """Target pose of the tool; its present pose without a correction."""
    correction: Correction | None = None
