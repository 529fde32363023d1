"""What dlokit publishes in ROS 2: the table of its topics, and their messages from plain values.

Units and axes are those of REP-103, names of topics and frames those of REP-135. Every function takes its stamp in ROS
time [ns], and has neither clock nor socket. A frame that is not named is `WORLD`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy

from dlokit import geometry
from dlokit.extras.ros2.definitions import Definitions
from dlokit.geometry.camera import Side, camera_alone, camera_matrix, turn_to_rectified
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.dlo import DloState
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

WORLD = "dlokit_world"
"""dlokit's world frame: its origin is on the table, z is the normal of the table's top."""
CAMERA = "dlokit_camera"
"""Frame of the (rectified left) camera: x right, y down, z forward."""
BASE = "base_link"
"""Usual frame of the base of the first arm."""

DEPTH = 10
"""Messages that wait for a reader of a volatile topic, as of ROS 2's own default."""


@dataclass(frozen=True, kw_only=True)
class Published:
    """One row of the table of published topics; all are offered reliably."""

    topic: str
    """Name; one that begins with ``~/`` is relative to the node."""
    kind: str
    """ROS type of its messages."""
    doc: str
    """Content, in one line."""
    transient_local: bool = False
    """Whether late subscribers get the last message."""
    depth: int = DEPTH
    """Messages that wait for a reader; 1 where each message replaces the one before."""
    on_demand: bool = False
    """Whether its messages are made only while the topic has subscribers."""


def _lasting(topic: str, kind: str, doc: str) -> Published:
    return Published(topic=topic, kind=kind, doc=doc, transient_local=True, depth=1)


def _on_demand(topic: str, kind: str, doc: str) -> Published:
    return Published(topic=topic, kind=f"sensor_msgs/msg/{kind}", doc=doc, on_demand=True)


def _volatile(topic: str, kind: str, doc: str) -> Published:
    return Published(topic=topic, kind=kind, doc=doc)


_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
_STATUS: Final = "diagnostic_msgs/msg/DiagnosticStatus"

# fmt: off
DLO         = _volatile("~/dlo", _CLOUD, "the DLO's nodes in order: x, y, z, std [m], visible, held (1 or 0)")
POSES       = _volatile("~/poses", "geometry_msgs/msg/PoseArray", "the nodes as poses: x along the DLO, z upward")
CLOUD       = _volatile("~/cloud", _CLOUD, "the DLO's points in the last look")
MARKERS     = _lasting("~/markers", "visualization_msgs/msg/MarkerArray", "state, goal, action, workspaces, fixtures")
GOAL        = _lasting("~/goal", "nav_msgs/msg/Path", "the shape the operator wants, node by node")
STATUS      = _lasting("~/status", _STATUS, "phase, step, action, RMSE, outcome, reason, stop latched")
TF_STATIC   = _lasting("/tf_static", "tf2_msgs/msg/TFMessage", "first arm's base to dlokit_world to dlokit_camera")
DIAGNOSTICS = _volatile("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "status of run and link, each second")
JOINTS      = _on_demand("~/joint_states", "JointState", "joints of the arms that dlokit moves")
LEFT        = _on_demand("~/left/image_raw", "Image", "left picture of dlokit's stereo camera (rgb8, mono8)")
LEFT_INFO   = _on_demand("~/left/camera_info", "CameraInfo", "calibration of the left camera")
RIGHT       = _on_demand("~/right/image_raw", "Image", "right picture of dlokit's stereo camera (rgb8, mono8)")
RIGHT_INFO  = _on_demand("~/right/camera_info", "CameraInfo", "calibration of the right camera")
COLOUR      = _on_demand("~/colour/image_raw", "Image", "picture of dlokit's depth camera (rgb8, mono8)")
COLOUR_INFO = _on_demand("~/colour/camera_info", "CameraInfo", "calibration of the depth camera")
DEPTHS      = _on_demand("~/depth/image_raw", "Image", "depths aligned to colour (32FC1 [m], NaN where unknown)")
DEPTHS_INFO = _on_demand("~/depth/camera_info", "CameraInfo", "calibration of the depths, that of colour")
# fmt: on

PUBLISHED: tuple[Published, ...] = tuple(row for row in list(globals().values()) if isinstance(row, Published))
"""The table of published topics."""


@dataclass(frozen=True, kw_only=True)
class Outgoing:
    """A message to publish."""

    row: Published
    message: Any
    """A message of the row's type, as `Definitions.make` makes it."""


NODE = "/dlokit"
"""Usual full name of the node."""


def absolute(topic: str, node: str = NODE) -> str:
    """The full name of a topic of the table: ``~/dlo`` is ``/dlokit/dlo``."""
    return f"{node}/{topic[2:]}" if topic.startswith("~/") else topic


def ros_time(ros: Definitions, stamp: int) -> Any:
    """A time [ns] as ``builtin_interfaces/msg/Time``."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return ros.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)


def header(ros: Definitions, stamp: int, frame: str = WORLD) -> Any:
    """A header with a stamp [ns] and a frame."""
    return ros.make("std_msgs/msg/Header", stamp=ros_time(ros, stamp), frame_id=frame)


def vector(ros: Definitions, values: Sequence[float], kind: str = "Vector3") -> Any:
    """Three numbers as ``geometry_msgs/msg/Vector3``, or as a ``Point``."""
    x, y, z = values
    return ros.make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def point_list(ros: Definitions, points_world: Float64Array) -> list[Any]:
    """Points (N, 3) [m] as ``geometry_msgs/msg/Point``."""
    return [vector(ros, point, "Point") for point in points_world.tolist()]


def quaternion(ros: Definitions, xyzw: Sequence[float]) -> Any:
    """A unit quaternion in ROS's order, the scalar last."""
    x, y, z, w = xyzw
    return ros.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def ros_pose(ros: Definitions, position_m: Sequence[float], xyzw: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
    """A pose from its position [m] and unit quaternion, the scalar last."""
    position = vector(ros, position_m, "Point")
    return ros.make("geometry_msgs/msg/Pose", position=position, orientation=quaternion(ros, xyzw))


def point_cloud(ros: Definitions, stamp: int, columns: Mapping[str, Float32Array]) -> Any:
    """A PointCloud2 of equally long float32 columns (N,), x, y and z first.

    All fields have one datatype, because `read_points_numpy` of ROS's `sensor_msgs_py` reads no other clouds; RViz
    colours by any of them.
    """
    table = np.column_stack(tuple(columns.values())).astype("<f4", copy=False)
    names = [(name, 4 * number) for number, name in enumerate(columns)]
    return ros.make(
        _CLOUD,
        header=header(ros, stamp),
        height=1,
        width=len(table),
        fields=[
            ros.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=_FLOAT32, count=1)
            for name, offset in names
        ],
        is_bigendian=False,
        point_step=4 * len(names),
        row_step=4 * len(names) * len(table),
        data=np.frombuffer(table.tobytes(), dtype=np.uint8),
        is_dense=bool(np.isfinite(table[:, :3]).all()),
    )


_FLOAT32: Final = 7
"""PointField.FLOAT32."""


def dlo_cloud(ros: Definitions, stamp: int, state: DloState, held: Sequence[int] = ()) -> Any:
    """The nodes in order, one point each: x, y, z, std, visible, held; `held` are nodes between fingers.

    std is the root of the mean variance of x, y and z [m]; NaN without a covariance. visible is 0 for all nodes before
    the first observation.
    """
    nodes = state.nodes_world
    std = np.full(len(nodes), np.nan)
    if state.covariance is not None:
        std = np.sqrt(np.maximum(np.trace(state.covariance, axis1=1, axis2=2), 0.0) / 3.0)
    holding: BoolArray = np.zeros(len(nodes), dtype=np.bool_)
    holding[[node for node in held if 0 <= node < len(nodes)]] = True
    visible = np.zeros(len(nodes), dtype=np.bool_) if state.visible is None else state.visible
    extra = {"std": std, "visible": visible, "held": holding}
    return point_cloud(ros, stamp, _xyz(nodes) | {name: of.astype(np.float32) for name, of in extra.items()})


def seen_cloud(ros: Definitions, stamp: int, points_world: Float32Array, colors: UInt8Array | None = None) -> Any:
    """Points (N, 3) [m], with their colours (N, 3) RGB in a field `rgb` as RViz and PCL read it."""
    columns = _xyz(points_world)
    if colors is not None:
        red, green, blue = colors.astype(np.uint32).T
        columns["rgb"] = ((red << 16) | (green << 8) | blue).view(np.float32)
    return point_cloud(ros, stamp, columns)


def _xyz(points: Float32Array | Float64Array) -> dict[str, Float32Array]:
    x, y, z = np.ascontiguousarray(points.reshape(-1, 3).T, dtype=np.float32)
    return {"x": x, "y": y, "z": z}


def node_rotations(nodes_world: Float64Array) -> Float64Array:
    """Unit quaternions (M, 4), scalar last, of frames at nodes (M, 3) [m]: x along the DLO, z as upward as possible.

    Where the DLO is vertical, y is that of the nearest node where it is not, and the world's y where it is vertical
    everywhere. Where nodes coincide, x is that of the nearest node where they do not.
    """
    x = geometry.tangents(nodes_world)
    x = _from_nearest(x, np.linalg.norm(x, axis=1) > 0.5, np.array([1.0, 0.0, 0.0]))
    level = np.column_stack((-x[:, 1], x[:, 0], np.zeros(len(x))))  # z of the world × x
    length = np.linalg.norm(level, axis=1, keepdims=True)
    y = _from_nearest(level / np.maximum(length, _VERTICAL), length[:, 0] > _VERTICAL, np.array([0.0, 1.0, 0.0]))
    z = np.cross(x, y)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    R = np.stack((x, np.cross(z, x), z), axis=2)
    return scipy.spatial.transform.Rotation.from_matrix(R).as_quat(canonical=True)


_VERTICAL = 1e-6
"""Horizontal part of a unit tangent below which it counts as vertical: rounding would decide about its direction."""


def _from_nearest(vectors: Float64Array, known: BoolArray, otherwise: Float64Array) -> Float64Array:
    """Vectors (M, 3), each unknown one replaced by that of the nearest row that is known."""
    if known.all():
        return vectors
    if not known.any():
        return np.tile(otherwise, (len(vectors), 1))
    rows = np.flatnonzero(known)
    nearest = rows[np.argmin(np.abs(np.arange(len(vectors))[:, None] - rows), axis=1)]
    return vectors[nearest]


def _node_poses(ros: Definitions, nodes_world: Float64Array) -> list[Any]:
    turned = node_rotations(nodes_world).tolist()
    return [ros_pose(ros, at, xyzw) for at, xyzw in zip(nodes_world.tolist(), turned, strict=True)]


def pose_array(ros: Definitions, stamp: int, nodes_world: Float64Array) -> Any:
    """The nodes (M, 3) [m] as poses, with the rotations of `node_rotations`."""
    return ros.make("geometry_msgs/msg/PoseArray", header=header(ros, stamp), poses=_node_poses(ros, nodes_world))


def goal_path(ros: Definitions, stamp: int, nodes_world: Float64Array) -> Any:
    """The nodes (M, 3) [m] of a goal as a path, with the rotations of `node_rotations`."""
    head = header(ros, stamp)
    poses = [
        ros.make("geometry_msgs/msg/PoseStamped", header=head, pose=pose) for pose in _node_poses(ros, nodes_world)
    ]
    return ros.make("nav_msgs/msg/Path", header=head, poses=poses)


def joint_state(ros: Definitions, stamp: int, names: Sequence[str], state: RobotState) -> Any:
    """Positions [rad], velocities [rad/s] and torques [N·m] of the joints of an arm."""
    return ros.make(
        "sensor_msgs/msg/JointState",
        header=header(ros, stamp, ""),
        name=list(names),
        position=state.q_rad,
        velocity=state.dq_rad_s,
        effort=state.tau_nm,
    )


def transforms(ros: Definitions, stamp: int, frames: Mapping[tuple[str, str], Pose]) -> Any:
    """A TFMessage of the poses of frames, by the names of parent and child: ``T_parent_child``."""
    return ros.make(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            ros.make(
                "geometry_msgs/msg/TransformStamped",
                header=header(ros, stamp, parent),
                child_frame_id=child,
                transform=ros.make(
                    "geometry_msgs/msg/Transform",
                    translation=vector(ros, pose.position_m.tolist()),
                    rotation=quaternion(ros, np.roll(pose.wxyz / np.linalg.norm(pose.wxyz), -1).tolist()),
                ),
            )
            for (parent, child), pose in frames.items()
        ],
    )


def image(ros: Definitions, stamp: int, pixels: UInt8Array) -> Any:
    """A picture (height, width, 3) RGB, or (height, width) grey."""
    return _image(ros, stamp, "rgb8" if pixels.ndim == 3 else "mono8", pixels)


def depth_image(ros: Definitions, stamp: int, depth_m: Float32Array) -> Any:
    """Depths (height, width) [m], 0 where unknown; NaN there in the message, by REP-118."""
    return _image(ros, stamp, "32FC1", np.where(depth_m > 0.0, depth_m, np.float32(np.nan)).astype("<f4", copy=False))


def _image(ros: Definitions, stamp: int, encoding: str, pixels: UInt8Array | Float32Array) -> Any:
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
    return ros.make(
        "sensor_msgs/msg/Image",
        header=header(ros, stamp, CAMERA),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=len(data) // max(height, 1),
        data=data,
    )


def camera_info(ros: Definitions, stamp: int, camera: CameraCalibration, side: Side = 0) -> Any:
    """Calibration of a camera, or of the left (0) or right (1) one of a pair, whose pictures are not rectified."""
    alone = camera_alone(camera, side)
    ideal = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    across_px = -camera.fx_px * (camera.baseline_m or 0.0) if side == 1 else 0.0
    lens = np.zeros(5) if alone.distortion is None else alone.distortion.astype(np.float64)
    if len(lens) == 4:  # plumb_bob has five: k3 is 0
        lens = np.append(lens, 0.0)
    return ros.make(
        "sensor_msgs/msg/CameraInfo",
        header=header(ros, stamp, CAMERA),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model="plumb_bob" if len(lens) == 5 else "rational_polynomial",
        d=lens,
        k=camera_matrix(alone.fx_px, alone.fy_px, alone.cx_px, alone.cy_px).ravel(),
        r=turn_to_rectified(camera, side).ravel(),
        p=np.column_stack((ideal, [across_px, 0.0, 0.0])).ravel(),
        binning_x=0,
        binning_y=0,
        roi=ros.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )
