"""Actions: one grasp-to-release each, of whatever kind."""

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
