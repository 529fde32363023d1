"""Foxglove's message types, as far as recordings use them: https://docs.foxglove.dev/docs/visualization/message-schemas

The names are theirs. Lengths in metres, angles as quaternions.
"""

import msgspec

from dlokit.communication.recording.plain import json_schema

FLOAT32 = 7
"""Of their enumeration of number types."""
LINE_STRIP = 0
INFO, WARNING, ERROR = 2, 3, 4
"""Of their levels of logs."""


class Time(msgspec.Struct, frozen=True, kw_only=True):
    """A moment, or a length of time."""

    sec: int = 0
    nsec: int = 0


class Vector3(msgspec.Struct, frozen=True, kw_only=True):
    """Also their Point3."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True, kw_only=True):
    """Scalar last."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(msgspec.Struct, frozen=True, kw_only=True):
    """Where something stands in its frame."""

    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


class Color(msgspec.Struct, frozen=True, kw_only=True):
    """Each from 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class CompressedImage(msgspec.Struct, frozen=True, kw_only=True):
    """A picture, `data` being a file of the format."""

    timestamp: Time
    frame_id: str
    data: bytes
    format: str


class CameraCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Row by row: K (3, 3), R (3, 3), P (3, 4)."""

    timestamp: Time
    frame_id: str
    width: int
    height: int
    distortion_model: str
    D: list[float]
    K: list[float]
    R: list[float]
    P: list[float]


class PackedElementField(msgspec.Struct, frozen=True, kw_only=True):
    """One coordinate of a cloud's points."""

    name: str
    offset: int
    type: int


class PointCloud(msgspec.Struct, frozen=True, kw_only=True):
    """Points, packed."""

    timestamp: Time
    frame_id: str
    pose: Pose
    point_stride: int
    fields: list[PackedElementField]
    data: bytes


class FrameTransform(msgspec.Struct, frozen=True, kw_only=True):
    """Where a frame stands in its parent."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class SpherePrimitive(msgspec.Struct, frozen=True, kw_only=True):
    """`size` holds diameters."""

    pose: Pose
    size: Vector3
    color: Color


class LinePrimitive(msgspec.Struct, frozen=True, kw_only=True):
    """Points joined by lines."""

    type: int
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: list[Vector3]
    color: Color
    colors: list[Color] = []
    indices: list[int] = []


class Unused(msgspec.Struct, frozen=True):
    """Kinds of shapes that recordings have none of."""


class SceneEntity(msgspec.Struct, frozen=True, kw_only=True):
    """A thing in the scene; it replaces the one with its `id`."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time = Time()
    frame_locked: bool = False
    metadata: list[Unused] = []
    arrows: list[Unused] = []
    cubes: list[Unused] = []
    spheres: list[SpherePrimitive] = []
    cylinders: list[Unused] = []
    lines: list[LinePrimitive] = []
    triangles: list[Unused] = []
    texts: list[Unused] = []
    models: list[Unused] = []


class SceneUpdate(msgspec.Struct, frozen=True, kw_only=True):
    """New or changed things."""

    deletions: list[Unused] = []
    entities: list[SceneEntity]


class Log(msgspec.Struct, frozen=True, kw_only=True):
    """A line for people."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


def time_of(stamp_ns: int) -> Time:
    """A stamp as they write it."""
    sec, nsec = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=sec, nsec=nsec)


def schema_name(kind: type[msgspec.Struct]) -> str:
    """The name by which their panels know a type."""
    return f"foxglove.{kind.__name__}"


def schema_of(kind: type[msgspec.Struct]) -> bytes:
    """Its JSON schema."""
    return json_schema(kind, {Time: "time", kind: schema_name(kind)})
