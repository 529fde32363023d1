"""The output of perception, and the events that the observer publishes in addition to its target points."""

import enum

from dlokit.types.arrays import Float32Array, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration
from dlokit.types.message import Message, Value


class GripperPin(Value, frozen=True, kw_only=True, eq=False):
    """A node that a gripper holds, with its position."""

    robot: str
    node: int
    position_world: Float32Array  # (3,) [m] position of the node, from the tool's pose


class Occlusion(Value, frozen=True, kw_only=True, eq=False):
    """Depth image of the known geometry of robots and fixtures from the camera's pose, at reduced resolution."""

    depth_m: Float32Array  # (height / scale, width / scale) along z of the camera [m]; inf where none of them is
    scale: int
    """Camera pixels per cell along each side."""


class PointCloud(Message, frozen=True, kw_only=True, eq=False):
    """Points in the world frame."""

    points_world: Float32Array  # (N, 3) [m]
    colors: UInt8Array | None = None  # (N, 3) RGB


class Observation(Message, frozen=True, kw_only=True, eq=False):
    """The DLO's points in one image pair, with the data that determine which nodes were hidden.

    Its stamp is that of the images.
    """

    points_world: Float32Array  # (N, 3) [m], filtered and downsampled; N may be 0
    calibration: CameraCalibration | None = None
    """The camera that took the images; None for a cloud of unknown origin."""
    occlusion: Occlusion | None = None
    pins: tuple[GripperPin, ...] = ()


class LookResult(Message, frozen=True, kw_only=True, eq=False):
    """Result of a look; its stamp is that of the images and of the published observation."""

    points: int
    """Number of points of the DLO."""


class CameraView(Message, frozen=True, kw_only=True, eq=False):
    """The camera as perception uses it: rectified, its pose corrected by the table and the hand."""

    calibration: CameraCalibration


class GraspState(Message, frozen=True, kw_only=True, eq=False):
    """Node that a gripper holds, according to the decision layer."""

    robot: str
    node: int | None
    """Node between the fingers; None: the gripper is empty."""
    node_tcp: Float64Array | None = None  # (3,) [m]
    """Position of the node in the tool's frame; None: at the tool centre point, or unknown."""


class ObserverEventKind(enum.Enum):
    """Kinds of events of the observer."""

    LOST = "lost"
    FOUND_AGAIN = "found_again"
    REFUSED = "refused"
    """The observer does not use the clouds; published at the first of them."""


class DistrustReason(enum.Enum):
    """Why the target points do not represent the cloud, or cannot be trusted."""

    NO_POINTS = "no_points"
    """Too few finite points."""
    FAR_POINTS = "far_points"
    """Most points are farther away than the DLO can have moved: the frame or the unit differs."""
    OLD_STAMP = "old_stamp"
    """The cloud is not newer than the state."""
    CLOCK_JUMPED = "clock_jumped"
    """The cloud is older than the previous one: its clock was set back. Tracking continues with the next cloud."""
    NOT_THE_DLO = "not_the_dlo"
    """Few points are near the DLO, and it is nowhere else in the cloud, which shows the table or another object."""
    BAD_TARGETS = "bad_targets"
    """The strategy failed, or its targets are not finite or differ in number from the nodes."""
    BAD_MEMORY = "bad_memory"
    """The strategy's memory is too large, or not named arrays of float64."""
    LOW_HEALTH = "low_health"
    """The strategy itself reports low confidence."""
    SHORTENED = "shortened"
    """The nodes are on the cloud, and the rod through them is much shorter than the DLO: hidden nodes were drawn onto
    the visible part."""
    ELSEWHERE = "elsewhere"
    """Ordering the cloud from scratch finds the DLO where the strategy did not."""


class ObserverEvent(Message, frozen=True, kw_only=True, eq=False):
    """One event of the observer, with the stamp of the cloud that caused it."""

    kind: ObserverEventKind
    reason: DistrustReason | None
    """None for `FOUND_AGAIN`."""
    health: float
