"""The Foxglove message types in recordings: https://docs.foxglove.dev/docs/visualization/message-schemas

They are written as Protobuf, the only encoding that both Foxglove and Rerun display. Lengths are in metres.
"""

from typing import Any, TypeVar

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration as CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color as Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage as CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform as FrameTransform
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive as LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log as Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField as PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3 as Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud as PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose as Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion as Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity as SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate as SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive as SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3 as Vector3
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError, Message
from google.protobuf.timestamp_pb2 import Timestamp

from dlokit.errors import CommunicationError

M = TypeVar("M", bound=Message)

ENCODING = "protobuf"
"""MCAP's name of the encoding of schemas and messages."""
UPRIGHT = Quaternion(w=1.0)
HERE = Pose(position=Vector3(), orientation=UPRIGHT)
"""The identity pose; an omitted pose would have an invalid orientation."""


def time_of(stamp_ns: int) -> Timestamp:
    """A stamp [ns] as a Protobuf timestamp."""
    seconds, nanos = divmod(stamp_ns, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def schema_name(kind: type[Message]) -> str:
    """Full name of a type, by which Foxglove's panels select messages."""
    return str(kind.DESCRIPTOR.full_name)


def schema_of(kind: type[Message]) -> bytes:
    """Schema of a type: the files that define it and its fields' types, each after its dependencies."""
    found = FileDescriptorSet()
    seen: set[str] = set()

    def add(file: Any) -> None:  # a descriptor; the library has two classes for it
        if file.name in seen:
            return
        seen.add(file.name)
        for needed in file.dependencies:
            add(needed)
        file.CopyToProto(found.file.add())

    add(kind.DESCRIPTOR.file)
    return found.SerializeToString(deterministic=True)


def from_bytes(data: bytes, kind: type[M]) -> M:
    """Decode a message. Raises `CommunicationError` if `data` is not of type `kind`."""
    message = kind()
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        raise CommunicationError(f"cannot decode {schema_name(kind)}: {error}") from error
    return message
