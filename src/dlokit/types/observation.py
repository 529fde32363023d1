"""What perception saw in one look, and what the observer tells beside its targets."""

import enum

from dlokit.types.arrays import Float32Array, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration
from dlokit.types.message import Message, Value


class GripperPin(Value, frozen=True, kw_only=True, eq=False):
    """A node that a gripper holds, and where."""

    robot: str
    node: int
    position_world: Float32Array  # (3,) [m] where the node is, by the tool's pose


class Occlusion(Value, frozen=True, kw_only=True, eq=False):
    """Depth of the robot's known geometry as the camera sees it, at reduced resolution."""

    depth_m: Float32Array  # (height / scale, width / scale) along z of the camera [m]; inf where no robot is
    scale: int
    """Camera pixels a cell, along each side."""


class PointCloud(Message, frozen=True, kw_only=True, eq=False):
    """Points in the world frame."""

    points_world: Float32Array  # (N, 3) [m]
    colors: UInt8Array | None = None  # (N, 3) RGB


class Observation(Message, frozen=True, kw_only=True, eq=False):
    """The DLO's points of one look, and what is needed to know which nodes could not be seen.

    The stamp is the pictures'.
    """

    points_world: Float32Array  # (N, 3) [m], filtered and thinned; N may be 0
    calibration: CameraCalibration | None = None
    """The camera that looked; None for a cloud of unknown origin."""
    occlusion: Occlusion | None = None
    pins: tuple[GripperPin, ...] = ()


class Gripped(Message, frozen=True, kw_only=True, eq=False):
    """Which node a gripper holds, as far as the decision layer knows."""

    robot: str
    node: int | None
    """Node between the fingers; None: nothing is held."""
    node_tcp: Float64Array | None = None  # (3,) [m]
    """Where the node is in the tool's frame; None: at the tool centre point, or unknown."""


class ObserverEventKind(enum.Enum):
    """What happened."""

    LOST = "lost"
    FOUND_AGAIN = "found_again"
    REFUSED = "refused"
    """Clouds are not used; told at the first of them."""


class Doubt(enum.Enum):
    """Why targets are not what the cloud shows, or not to be trusted."""

    NO_POINTS = "no_points"
    """Too few points that are numbers."""
    FAR_POINTS = "far_points"
    """Most points lie farther off than the DLO can have gone: another frame, or another unit."""
    OLD_STAMP = "old_stamp"
    """The cloud is not newer than the state."""
    NOT_THE_DLO = "not_the_dlo"
    """Hardly any point lies on the DLO, and it is nowhere else in the cloud: the table, or something else."""
    BAD_TARGETS = "bad_targets"
    """The strategy failed, or its targets are no numbers or not as many as there are nodes."""
    LOW_HEALTH = "low_health"
    """The strategy itself says so."""
    ELSEWHERE = "elsewhere"
    """The cloud, ordered anew, shows the DLO where the strategy did not find it."""


class ObserverEvent(Message, frozen=True, kw_only=True, eq=False):
    """One event, with the stamp of the cloud at which it happened."""

    kind: ObserverEventKind
    reason: Doubt | None
    """None when found again."""
    health: float
