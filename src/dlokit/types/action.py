"""Actions, one grasp-to-release each, what a planner considers while it decides, and small motions of a held node."""

import enum
import math

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT


class VelocityProfile(Value, frozen=True, kw_only=True, eq=False):
    """How fast the tool moves along a path; different profiles may give different shapes.

    Raises `BadValue` where one of the three is not a finite number above 0.
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
    """Where to take hold of the DLO."""

    node: int
    T_world_tcp: Pose
    """Tool centre point between the fingertips, its x axis along the rod, z (approach) down."""
    opening_m: float = 0.04
    """Finger opening on approach [m]."""


class Partner(Value, frozen=True, kw_only=True, eq=False):
    """What the second arm does of an action."""

    robot: str
    grasp: Grasp
    path: tuple[Pose, ...]
    velocity: VelocityProfile
    """Such that both paths take the same time."""


class Handling(Message, frozen=True, kw_only=True, eq=False):
    """One grasp-to-release: come down at a node, move on a path, go up again. Kinds differ in what the path does."""

    grasp: Grasp
    """Where the tool comes down."""
    path: tuple[Pose, ...]
    """Tool poses from there to the release, without the first itself."""
    velocity: VelocityProfile
    predicted_nodes_world: Float64Array | None = None  # (M, 3) [m] shape expected after it; None: not predicted
    robot: str = FIRST_ROBOT
    partner: Partner | None = None
    """What a second arm does at the same time: in a pair, and in no other kind."""


class PickPlace(Handling, frozen=True, kw_only=True, eq=False, tag="pick-and-place"):
    """Grasp a node, carry it along a path above the table, release it."""


class Drag(Handling, frozen=True, kw_only=True, eq=False, tag="drag"):
    """Grasp a node and draw it over the table, without lifting the rod."""


class LayDown(Handling, frozen=True, kw_only=True, eq=False, tag="lay-down"):
    """Grasp near an end, lift most of the rod, and lay it down along a curve."""


class Push(Handling, frozen=True, kw_only=True, eq=False, tag="push"):
    """Push the rod over the table with closed fingers, which come down beside it: nothing is held.

    Its grasp is where they come down, with the node that they push and an opening of zero.
    """


class PairPlace(Handling, frozen=True, kw_only=True, eq=False, tag="pair"):
    """Two arms grasp a node each, carry both at the same time, and release both.

    What is not the partner's is the first arm's.
    """


Action = PickPlace | Drag | LayDown | Push | PairPlace
"""Every kind of action."""


def kind_of(action: Action) -> str:
    """The kind of an action, in words."""
    return str(action.__struct_config__.tag)


class Marks(Value, frozen=True, kw_only=True, eq=False):
    """Grasp nodes that were tried since the shape last changed, in vain (Fig. 6)."""

    invalid_nodes: Int64Array  # (n,)


class CandidateSeen(Value, frozen=True, kw_only=True, eq=False):
    """One action that is considered."""

    kind: str
    """In words, as `types.action.kind_of` has it."""
    node: int
    """The node that would be grasped or pushed."""
    score_m: float
    """What would remain to be done, as the planner judges it [m]; less is better."""
    nodes_world: Float64Array  # (M, 3) [m] expected after it
    path_world: Float64Array  # (W, 3) [m] of the tool


class Candidates(Message, frozen=True, kw_only=True, eq=False):
    """How far a decision is: what was played through so far, and the best of it."""

    rollouts: int
    """Played through so far."""
    budget: int
    """To be played through, at most."""
    best: tuple[CandidateSeen, ...] = ()
    """The best few, best first."""


class HeldNode(Value, frozen=True, kw_only=True, eq=False):
    """A node between fingers."""

    node: int
    T_world_tcp: Pose
    """The tool that holds it."""


class Correction(Value, frozen=True, kw_only=True, eq=False):
    """A small motion of the tool while it holds the DLO, and what the model expects of it."""

    displacement: Float64Array  # (4,) x, y, z [m] and yaw [rad] of the tool, in the world
    released_world: Float64Array  # (M, 3) [m] the shape expected if the DLO were let go before it
    predicted_world: Float64Array  # (M, 3) [m] the shape expected if it is let go after it


class ControlForecast(Value, frozen=True, kw_only=True):
    """Whether control shall follow an action, by what is known before it."""

    follows: bool
    gain_m: float
    """RMSE that control is expected to mend [m]; what the eye could feign does not count."""


class ControlVerdict(enum.Enum):
    """Whether control can still bring the shape nearer to its goal."""

    CORRECT = "correct"
    """It can: do the correction, then look again."""
    SETTLED = "settled"
    """The shape is good enough, or too little is to be gained at this grasp: let go."""
    DEADLOCK = "deadlock"
    """The error is not small and control cannot reduce it: let go, and plan another grasp."""


class ControlAdvice(Value, frozen=True, kw_only=True, eq=False):
    """What to do with a DLO that is held."""

    verdict: ControlVerdict
    reason: str
    """Why not to go on, by name: good_enough, no_gain, in_doubt, badly_seen; no_progress, overstretch, out_of_reach.
    Empty when a correction is advised."""
    rmse_m: float
    """Error to the goal expected if the DLO were let go now [m]."""
    then_rmse_m: float
    """The same after the correction [m]; without one, the same as `rmse_m`."""
    target: Pose
    """Where the tool goes; where it is, when no correction is advised."""
    correction: Correction | None = None
