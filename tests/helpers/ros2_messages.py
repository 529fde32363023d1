"""Messages and bags of ROS 2 cameras, in the layouts of realsense-ros and of the ZED's driver."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dlokit.extras.ros2.definitions import Definitions, definitions_of
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
CLOUD, TF = "sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage"
OLD_TF = "tf/msg/tfMessage"

DEFINITIONS: Definitions = definitions_of("jazzy")
DTYPES = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}


def header(stamp_ns: int, frame: str) -> Any:
    stamp = DEFINITIONS.make(
        "builtin_interfaces/msg/Time", sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000
    )
    return DEFINITIONS.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def image(
    pixels: NDArray[Any],
    encoding: str,
    *,
    stamp_ns: int = 0,
    frame: str = "camera",
    padding: int = 0,
    big: bool = False,
) -> Any:
    """An Image of pixels (height, width) or (height, width, channels), with `padding` bytes after each row."""
    height, width = pixels.shape[:2]
    ordered = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
    rows = np.frombuffer(ordered.tobytes(), dtype=np.uint8).reshape(height, -1)
    padded = np.concatenate([rows, np.full((height, padding), 7, dtype=np.uint8)], axis=1)
    return DEFINITIONS.make(
        IMAGE,
        header=header(stamp_ns, frame),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(big),
        step=padded.shape[1],
        data=padded.ravel(),
    )


def compressed(data: bytes, form: str, *, stamp_ns: int = 0, frame: str = "camera") -> Any:
    return DEFINITIONS.make(
        COMPRESSED, header=header(stamp_ns, frame), format=form, data=np.frombuffer(data, dtype=np.uint8)
    )


def info(
    camera: CameraCalibration,
    *,
    stamp_ns: int = 0,
    frame: str = "camera",
    model: str = "plumb_bob",
    d: Sequence[float] = (0.0,) * 5,
    K: Sequence[float] | None = None,
    R: NDArray[np.float64] | None = None,
    P: Sequence[float] | None = None,
    shift_m: float = 0.0,
    binning: int = 0,
    roi: tuple[int, int, int, int] = (0, 0, 0, 0),
) -> Any:
    """The CameraInfo of a camera; `roi` is x, y, width, height; `shift_m` as of a pair's right camera."""
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    part = DEFINITIONS.make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=roi[0],
        y_offset=roi[1],
        height=roi[3],
        width=roi[2],
        do_rectify=False,
    )
    return DEFINITIONS.make(
        INFO,
        header=header(stamp_ns, frame),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model=model,
        d=np.array(d, dtype=np.float64),
        k=np.array(K or (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0), dtype=np.float64),
        r=(np.eye(3) if R is None else R).ravel(),
        p=np.array(P or (fx, 0.0, cx, -fx * shift_m, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0), dtype=np.float64),
        binning_x=binning,
        binning_y=binning,
        roi=part,
    )


def cloud(
    points: NDArray[np.float32],
    colours: NDArray[np.uint8] | None,
    *,
    stamp_ns: int = 0,
    frame: str = "camera_optical",
    separate: bool = False,
    big: bool = False,
) -> Any:
    """A PointCloud2 of points (height, width, 3) [m] and colours of the same shape, as rgb or separate r, g and b."""
    height, width = points.shape[:2]
    order = ">" if big else "<"
    fields = [(name, f"{order}f4", 7, 4 * number) for number, name in enumerate("xyz")]
    if colours is not None and separate:
        fields += [(name, "u1", 2, 16 + number) for number, name in enumerate("rgb")]
    elif colours is not None:
        fields.append(("rgb", f"{order}u4", 7, 16))
    names, forms, _, offsets = zip(*fields, strict=True)
    values = np.zeros(
        (height, width),
        dtype=np.dtype({"names": list(names), "formats": list(forms), "offsets": list(offsets), "itemsize": 32}),
    )
    for number, name in enumerate("xyz"):
        values[name] = points[..., number]
    if colours is not None and separate:
        for number, name in enumerate("rgb"):
            values[name] = colours[..., number]
    elif colours is not None:
        red, green, blue = (colours[..., number].astype(np.uint32) for number in range(3))
        values["rgb"] = (red << 16) | (green << 8) | blue
    made = [
        DEFINITIONS.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=datatype, count=1)
        for name, _, datatype, offset in fields
    ]
    return DEFINITIONS.make(
        CLOUD,
        header=header(stamp_ns, frame),
        height=height,
        width=width,
        fields=made,
        is_bigendian=big,
        point_step=32,
        row_step=32 * width,
        data=np.frombuffer(values.tobytes(), dtype=np.uint8),
        is_dense=False,
    )


def tf(*edges: tuple[str, str, Pose], stamp_ns: int = 0) -> Any:
    """A TFMessage of transforms (parent, child, T_parent_child)."""
    return DEFINITIONS.make(TF, transforms=[_transform(*edge, stamp_ns) for edge in edges])


def _transform(parent: str, child: str, T: Pose, stamp_ns: int) -> Any:
    x, y, z = (float(value) for value in T.position_m)
    qw, qx, qy, qz = (float(value) for value in T.wxyz)
    return DEFINITIONS.make(
        "geometry_msgs/msg/TransformStamped",
        header=header(stamp_ns, parent),
        child_frame_id=child,
        transform=DEFINITIONS.make(
            "geometry_msgs/msg/Transform",
            translation=DEFINITIONS.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=DEFINITIONS.make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        ),
    )


def raw(x: float, y: float, z: float, w: float, parent: str = "a", child: str = "b") -> Any:
    """A TFMessage whose quaternion need not have norm 1."""
    message = tf((parent, child, Pose(position_m=np.zeros(3), wxyz=np.array([1.0, 0.0, 0.0, 0.0]))))
    message.transforms[0].transform.rotation = DEFINITIONS.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    return message


def cdr(message: Any) -> bytes:
    return DEFINITIONS.encode(message.__msgtype__, message)


class Sent(NamedTuple):
    """A message of a topic and the time of its recording [ns]."""

    topic: str
    message: Any
    log_ns: int


def write_bag(
    path: Path,
    sent: Sequence[Sent],
    *,
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write a bag, a folder, as ROS's recorder does."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for one in sent:
            kind = one.message.__msgtype__
            if one.topic not in connections:
                qos: Sequence[Qos] = ()
                connections[one.topic] = writer.add_connection(
                    one.topic, kind, typestore=store, offered_qos_profiles=qos
                )
            writer.write(connections[one.topic], one.log_ns, cdr(one.message))
    return path


def write_ros1_bag(
    path: Path, sent: Sequence[Sent], *, compression: Ros1Writer.CompressionFormat | None = None
) -> Path:
    """Write a bag of ROS 1, a file, as `rosbag record` does; its messages are those of ROS 1 with the same fields."""
    ours, noetic = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
    for name in (TF, OLD_TF):
        noetic.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    writer = Ros1Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections: dict[str, Any] = {}
        for one in sent:
            kind = one.message.__msgtype__
            if one.topic not in connections:
                # tf's own publishers of static transforms use the older type.
                named = OLD_TF if one.topic == "/tf" else kind
                connections[one.topic] = writer.add_connection(one.topic, named, typestore=noetic)
            data = bytes(ours.cdr_to_ros1(cdr(one.message), kind))
            noetic.deserialize_ros1(data, kind)  # as a node of ROS 1 reads it
            writer.write(connections[one.topic], one.log_ns, data)
    return path
