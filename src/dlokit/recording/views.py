"""Conversion of messages to views for Foxglove's panels: images, clouds, frames, the rod in the scene, and a log."""

import numpy as np
from numpy.typing import NDArray

from dlokit.errors import CommunicationError
from dlokit.geometry.camera import camera_alone, camera_matrix, turn_to_rectified
from dlokit.recording import foxglove as fox
from dlokit.recording.channels import DEPTH_FORMAT, IMAGE_FORMAT, IMAGE_QUALITY
from dlokit.types.arrays import Float32Array, Float64Array, UInt8Array
from dlokit.types.dlo import DloState, GoalShape, TargetPoints
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import FlowStatus, RunOutcome
from dlokit.types.image import CameraCalibration, DepthImage, StereoImages
from dlokit.types.message import Message
from dlokit.types.observation import Observation, ObserverEvent
from dlokit.types.outcome import CallEnd, CallRecord
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState


def to_jpeg(pixels: UInt8Array) -> bytes:
    """Encode an image (height, width, 3) RGB, or (height, width) grey, as JPEG."""
    import cv2  # here, so that other topics can be read and written without loading it

    picture = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if pixels.ndim == 3 else pixels
    _, data = cv2.imencode(f".{IMAGE_FORMAT}", picture, [cv2.IMWRITE_JPEG_QUALITY, IMAGE_QUALITY])
    return data.tobytes()


def from_jpeg(data: bytes) -> UInt8Array:
    """Decode a JPEG image to (height, width, 3) RGB. Raises `CommunicationError` if `data` is not an image."""
    import cv2

    picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise CommunicationError("a recorded image cannot be decoded: its bytes are not a JPEG file")
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def to_png(depth_m: Float32Array) -> bytes:
    """Encode depths (height, width) [m] as whole millimetres in a PNG of 16 bits; 0 where unknown or above 65 m."""
    import cv2

    steps = np.round(depth_m.astype(np.float64) * _STEPS_PER_M)
    _, data = cv2.imencode(f".{DEPTH_FORMAT}", np.where(steps < 2**16, steps, 0.0).astype(np.uint16))
    return data.tobytes()


def from_png(data: bytes) -> Float32Array:
    """Decode depths to (height, width) [m]. Raises `CommunicationError` if `data` is not such an image."""
    import cv2

    steps = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if steps is None or steps.ndim != 2 or steps.dtype != np.uint16:
        raise CommunicationError("a recorded depth image cannot be decoded: its bytes are not a PNG file of 16 bits")
    return depth_m_of(steps.astype(np.uint16, copy=False))


def depth_m_of(steps: NDArray[np.uint16]) -> Float32Array:
    """Depths (height, width) [m] of whole millimetres."""
    return (steps / _STEPS_PER_M).astype(np.float32)


_STEPS_PER_M = 1000.0

View = fox.FrameTransform | fox.CompressedImage | fox.CameraCalibration | fox.PointCloud | fox.SceneUpdate | fox.Log

VIEWS: dict[str, type[View]] = {
    "view/tool": fox.FrameTransform,
    "view/camera_frame": fox.FrameTransform,
    "view/camera": fox.CameraCalibration,
    "view/left": fox.CompressedImage,
    "view/right": fox.CompressedImage,
    "view/colour": fox.CompressedImage,
    "view/depth": fox.CompressedImage,
    "view/cloud": fox.PointCloud,
    "view/scene": fox.SceneUpdate,
    "view/rod": fox.PointCloud,
    "view/targets": fox.PointCloud,
    "view/goal": fox.PointCloud,
    "view/log": fox.Log,
}
"""Every channel for Foxglove, with its message type."""

WORLD = "world"
CAMERA = "camera"

_ROD = fox.Color(r=0.95, g=0.55, b=0.1, a=1.0)
_TARGETS = fox.Color(r=0.1, g=0.45, b=0.95, a=1.0)
_GOAL = fox.Color(r=0.2, g=0.75, b=0.3, a=0.7)
_FIXTURES = fox.Color(r=0.93, g=0.90, b=0.85, a=1.0)
_DIAMETER_M = 0.008
_EDGE_M = 0.0015


def views_of(message: Message) -> list[tuple[str, View]]:
    """Views of a message, with their channels; the writer encodes images itself."""
    match message:
        case RobotState():
            return [("view/tool", _frame(message.stamp_ns, f"{message.robot}_tool", message.T_world_tcp))]
        case StereoImages() | DepthImage():
            pose = message.calibration.T_world_camera
            return [
                ("view/camera_frame", _frame(message.stamp_ns, CAMERA, pose)),
                ("view/camera", _camera(message.stamp_ns, message.calibration)),
            ]
        case Observation():
            return [("view/cloud", _cloud(message.stamp_ns, message.points_world))]
        case DloState():
            return _both("rod", message, _rod(message.stamp_ns, "rod", message.nodes_world, _ROD))
        case GoalShape():
            return _both("goal", message, _rod(message.stamp_ns, "goal", message.nodes_world, _GOAL))
        case TargetPoints():
            visible = message.nodes_world[message.visible]
            return _both("targets", message, _points(message.stamp_ns, "targets", visible))
        case FlowStatus() | ObserverEvent() | GoalVerdict() | CallRecord():
            return [("view/log", _log(message))]
        case _:
            return []


def _vector(position: Float64Array) -> fox.Vector3:
    x, y, z = position.tolist()
    return fox.Vector3(x=x, y=y, z=z)


def _frame(stamp_ns: int, name: str, pose: Pose) -> fox.FrameTransform:
    w, x, y, z = pose.wxyz.tolist()
    return fox.FrameTransform(
        timestamp=fox.time_of(stamp_ns),
        parent_frame_id=WORLD,
        child_frame_id=name,
        translation=_vector(pose.position_m),
        rotation=fox.Quaternion(x=x, y=y, z=z, w=w),
    )


def _camera(stamp_ns: int, camera: CameraCalibration) -> fox.CameraCalibration:
    ideal = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    taken = camera_alone(camera, 0)
    lens = [] if taken.distortion is None else taken.distortion.tolist()
    return fox.CameraCalibration(
        timestamp=fox.time_of(stamp_ns),
        frame_id=CAMERA,
        width=camera.width_px,
        height=camera.height_px,
        distortion_model=("plumb_bob" if len(lens) <= 5 else "rational_polynomial") if lens else "",
        D=lens,
        K=camera_matrix(taken.fx_px, taken.fy_px, taken.cx_px, taken.cy_px).ravel().tolist(),
        R=turn_to_rectified(camera, 0).ravel().tolist(),
        P=np.column_stack((ideal, np.zeros(3))).ravel().tolist(),
    )


def _both(name: str, message: DloState | GoalShape | TargetPoints, drawn: fox.SceneUpdate) -> list[tuple[str, View]]:
    """A shape as a scene, and its nodes as a cloud, because Rerun does not display scenes."""
    return [("view/scene", drawn), (f"view/{name}", _cloud(message.stamp_ns, message.nodes_world))]


def _cloud(stamp_ns: int, points_world: Float32Array | Float64Array) -> fox.PointCloud:
    points = np.ascontiguousarray(points_world, dtype="<f4")
    return fox.PointCloud(
        timestamp=fox.time_of(stamp_ns),
        frame_id=WORLD,
        pose=fox.HERE,
        point_stride=12,
        fields=[
            fox.PackedElementField(name=name, offset=4 * i, type=fox.PackedElementField.FLOAT32)
            for i, name in enumerate("xyz")
        ],
        data=points.tobytes(),
    )


def fixtures_view(stamp_ns: int, edges_world: Float64Array) -> fox.SceneUpdate:
    """The edges (E, 2, 3) [m] of the believed fixtures, for the channel view/scene."""
    return _lines(stamp_ns, "fixtures", edges_world.reshape(-1, 3), _FIXTURES, _EDGE_M, strip=False)


def _rod(stamp_ns: int, name: str, nodes_world: Float64Array, color: fox.Color) -> fox.SceneUpdate:
    return _lines(stamp_ns, name, nodes_world, color, _DIAMETER_M)


def _lines(
    stamp_ns: int, name: str, points_world: Float64Array, color: fox.Color, width_m: float, *, strip: bool = True
) -> fox.SceneUpdate:
    line = fox.LinePrimitive(
        type=fox.LinePrimitive.LINE_STRIP if strip else fox.LinePrimitive.LINE_LIST,
        pose=fox.HERE,
        thickness=width_m,
        scale_invariant=False,
        points=[fox.Point3(x=x, y=y, z=z) for x, y, z in points_world.tolist() if np.isfinite((x, y, z)).all()],
        color=color,
    )
    entity = fox.SceneEntity(timestamp=fox.time_of(stamp_ns), frame_id=WORLD, id=name, lines=[line])
    return fox.SceneUpdate(entities=[entity])


def _points(stamp_ns: int, name: str, points_world: Float64Array) -> fox.SceneUpdate:
    size = fox.Vector3(x=_DIAMETER_M, y=_DIAMETER_M, z=_DIAMETER_M)
    spheres = [
        fox.SpherePrimitive(pose=fox.Pose(position=_vector(point), orientation=fox.UPRIGHT), size=size, color=_TARGETS)
        for point in points_world
        if np.isfinite(point).all()
    ]
    entity = fox.SceneEntity(timestamp=fox.time_of(stamp_ns), frame_id=WORLD, id=name, spheres=spheres)
    return fox.SceneUpdate(entities=[entity])


def _log(message: FlowStatus | ObserverEvent | GoalVerdict | CallRecord) -> fox.Log:
    match message:
        case FlowStatus():
            level = fox.Log.WARNING if message.outcome not in (None, RunOutcome.CONVERGED) else fox.Log.INFO
            name, text = message.flow, f"{message.step}: {message.text}"
        case ObserverEvent():
            level, name = fox.Log.WARNING, "observer"
            text = message.kind.value if message.reason is None else f"{message.kind.value}: {message.reason.value}"
        case GoalVerdict():
            level = fox.Log.INFO if message.standing is Standing.HOLDS else fox.Log.WARNING
            name, text = "planning", message.text
        case CallRecord():
            level = fox.Log.INFO if message.outcome is CallEnd.SUCCEEDED else fox.Log.WARNING
            name = message.skill
            text = " ".join(part for part in (message.outcome.value, message.reason, message.detail) if part)
    return fox.Log(timestamp=fox.time_of(message.stamp_ns), level=level, message=text, name=name)
