"""Point clouds (`sensor_msgs/msg/PointCloud2`) as the pictures of a depth camera.

Every function raises `HardwareError`: what was found, what is taken, what to do.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.errors import BadValue, HardwareError
from dlokit.extras.ros2.pictures.camera_info import Intrinsics
from dlokit.geometry import pose
from dlokit.types.arrays import BoolArray, Float32Array, Int64Array, UInt8Array
from dlokit.types.image import CameraCalibration, DepthImage
from dlokit.types.pose import Pose

_FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of a PointField."""
_PACKED = ("rgb", "rgba")
"""Fields that hold a colour as 0xAARRGGBB, in a number of 32 bits of any type."""
_STRAIGHT = pose((0.0, 0.0, 0.0))
_ALONG_X = pose((0.0, 0.0, 0.0), (0.5, -0.5, 0.5, -0.5))
"""A camera (x right, y down, z forward) in a frame with x forward, y left, z up (REP-103)."""
_SAMPLES = 10_000
"""Points from which optics and the direction of view are found, evenly out of all."""
_LEAST_POINTS = 100
"""A cloud of fewer points shows no DLO, and optics cannot be fitted to it."""
_FIT_PX = 0.5
"""Largest residual of fitted optics (root mean square) [px]: a point must be in the pixel that shows it."""
_MEAN_FORWARD = 0.5
"""Least mean cosine between points and the direction of view: a camera that sees 120° has 0.8."""
_WIDEST = 1.8
"""Largest tangent of the angle between the direction of view and a point: a camera that sees 120° has 1.7."""
_HOLES = 0.02
"""Fraction of pixels without a point among pixels with points that a drawn cloud may have."""
_FOCAL_PX = (64.0, 2048.0)
"""Smallest and largest focal length of a drawn cloud [px]: of 1,000 points at 1 m, and of a sensor of 4 megapixels."""
_FINER = 2.0**0.25
"""Step of the focal lengths. Clouds of one camera that differ a little get the same one."""
_MOST_PIXELS = 4_000_000
"""Largest drawn picture [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points:
    """The points of a cloud in the camera's frame; not finite where unknown."""

    right_m: NDArray[np.floating[Any]]  # (height, width)
    down_m: NDArray[np.floating[Any]]  # (height, width)
    depth_m: NDArray[np.floating[Any]]  # (height, width)


def camera_in_frame(cloud: Any, topic: str) -> Pose:
    """Pose of the camera (x right, y down, z forward) in the cloud's frame: the identity, or turned if that looks
    along x, as a frame that is not called optical may."""
    values = _values(cloud, topic)
    return _ALONG_X if _looks_along_x(values, cloud.header.frame_id, topic) else _STRAIGHT


def is_organised(cloud: Any) -> bool:
    """Whether the cloud is a picture with a point for each pixel."""
    return cloud.height > 1


def picture_of(cloud: Any, optics: Intrinsics | None, T_world_camera: Pose, stamp_ns: int, topic: str) -> DepthImage:
    """A cloud as the picture of a depth camera; `optics` are those of an organised one, fitted to its points if None.

    A cloud that is not organised is drawn into the picture of a camera with the finest pixels that leave no holes
    between its points; the nearest point in a pixel counts.
    """
    values = _values(cloud, topic)
    points, colours = _points(cloud, values, topic), _colours(values, topic)
    if is_organised(cloud):
        pixels, depth_m = colours, _known(points.depth_m)
        optics = _fitted(points, depth_m > 0.0, topic) if optics is None else optics
    else:
        pixels, depth_m, optics = _drawn(points, colours, topic)
    try:
        calibration = CameraCalibration(
            width_px=pixels.shape[1],
            height_px=pixels.shape[0],
            fx_px=optics[0],
            fy_px=optics[1],
            cx_px=optics[2],
            cy_px=optics[3],
            T_world_camera=T_world_camera,
        )
    except BadValue as error:
        raise HardwareError(f"the cloud {topic} is not the picture of a camera: {error}") from error
    return DepthImage(stamp_ns=stamp_ns, frame="camera", pixels=pixels, depth_m=depth_m, calibration=calibration)


def _values(cloud: Any, topic: str) -> NDArray[Any]:
    """The fields that are needed, as a structured array (height, width)."""
    order = ">" if cloud.is_bigendian else "<"
    fields: dict[str, tuple[str, int]] = {}
    for one in cloud.fields:
        if one.name in ("x", "y", "z", "r", "g", "b") and one.datatype in _FORMATS:
            fields[one.name] = (order + _FORMATS[one.datatype], one.offset)
        elif one.name in _PACKED and one.datatype in (5, 6, 7):
            fields["packed"] = (order + "u4", one.offset)
    lacks = [name for name in "xyz" if name not in fields]
    if lacks:
        raise HardwareError(
            f"the cloud {topic} has the fields {', '.join(one.name for one in cloud.fields)}; x, y and z are needed"
        )
    ends = [offset + np.dtype(form).itemsize for form, offset in fields.values()]
    row = cloud.width * cloud.point_step
    if (
        row == 0
        or max(ends) > cloud.point_step
        or cloud.row_step < row
        or len(cloud.data) < cloud.height * cloud.row_step
    ):
        raise HardwareError(
            f"the cloud {topic} is damaged or empty: {len(cloud.data)} bytes in rows of {cloud.row_step} are not "
            f"{cloud.height} rows of {cloud.width} points of {cloud.point_step} bytes"
        )
    names = list(fields)
    dtype = np.dtype(
        {
            "names": names,
            "formats": [fields[name][0] for name in names],
            "offsets": [fields[name][1] for name in names],
            "itemsize": cloud.point_step,
        }
    )
    data = np.asarray(cloud.data, dtype=np.uint8)[: cloud.height * cloud.row_step]
    return data.reshape(cloud.height, cloud.row_step)[:, :row].view(dtype)


def _points(cloud: Any, values: NDArray[Any], topic: str) -> _Points:
    x, y, z = values["x"], values["y"], values["z"]
    if _looks_along_x(values, cloud.header.frame_id, topic):
        return _Points(right_m=-y, down_m=-z, depth_m=x)
    return _Points(right_m=x, down_m=y, depth_m=z)


def _looks_along_x(values: NDArray[Any], frame: str, topic: str) -> bool:
    if "optical" in frame:
        return False
    some = values.ravel()[:: max(1, values.size // _SAMPLES)]
    points = np.column_stack([some[axis] for axis in "xyz"]).astype(np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    distance_m = np.linalg.norm(points, axis=1)
    if not (far := distance_m > 0.0).any():
        return False
    forward_x, _, forward_z = (points[far] / distance_m[far, None]).mean(axis=0)
    if max(forward_x, forward_z) < _MEAN_FORWARD:
        raise HardwareError(
            f"the cloud {topic} is not seen from its frame {frame!r}: its points are neither along z nor along x of "
            "it; publish it in the frame of the camera that sees it"
        )
    return bool(forward_x > forward_z)


def _colours(values: NDArray[Any], topic: str) -> UInt8Array:
    """The colours (height, width, 3) RGB of a cloud."""
    names = values.dtype.names or ()
    if "packed" in names:
        packed = values["packed"].astype("<u4")
        channels = packed.view(np.uint8).reshape(*packed.shape, 4)  # blue, green, red, alpha
        return np.asarray(cv2.cvtColor(channels, cv2.COLOR_BGRA2RGB), dtype=np.uint8)
    if all(name in names and values.dtype[name] == np.uint8 for name in "rgb"):
        return np.stack([values[name] for name in "rgb"], axis=-1)
    raise HardwareError(
        f"the cloud {topic} has no colours; needed is a field rgb or rgba (4 bytes), or r, g and b (uint8), by which "
        "a DLO is told from the table: turn the colours on in the camera's driver, or name colour and depth pictures"
    )


def _known(depth_m: NDArray[np.floating[Any]]) -> Float32Array:
    known = (depth_m > 0.0) & (depth_m < np.inf)  # NaN is neither
    return np.where(known, depth_m, 0.0).astype(np.float32)


def _fitted(points: _Points, known: BoolArray, topic: str) -> Intrinsics:
    """Optics of the camera whose picture an organised cloud is, by least squares over its points."""
    rows, columns = np.nonzero(known)
    every = max(1, len(rows) // _SAMPLES)
    rows, columns = rows[::every], columns[::every]
    if len(rows) < _LEAST_POINTS or np.ptp(rows) == 0 or np.ptp(columns) == 0:
        raise HardwareError(
            f"the cloud {topic} has {np.count_nonzero(known)} points with a depth; optics cannot be fitted to fewer "
            f"than {_LEAST_POINTS}: give it a view of the table"
        )
    depth_m = points.depth_m[rows, columns].astype(np.float64)
    fx, cx, across_px = _line(points.right_m[rows, columns] / depth_m, columns)
    fy, cy, down_px = _line(points.down_m[rows, columns] / depth_m, rows)
    residual_px = max(across_px, down_px)
    if not residual_px <= _FIT_PX:
        raise HardwareError(
            f"the cloud {topic} is {points.depth_m.shape[1]} by {points.depth_m.shape[0]} points, but not the picture "
            f"of a pinhole camera: points are {residual_px:.1f} px beside their pixels, allowed are {_FIT_PX} px; "
            "publish the driver's own cloud, not a transformed or filtered one"
        )
    return fx, fy, cx, cy


def _line(tangents: NDArray[np.float64], pixels: Int64Array) -> tuple[float, float, float]:
    """Focal length, centre, and residual (root mean square) [px] of ``pixel = focal * tangent + centre``."""
    across, mean = tangents - tangents.mean(), float(pixels.mean())
    focal = float((across * (pixels - mean)).sum()) / max(1e-12, float((across * across).sum()))
    residual = focal * across - (pixels - mean)
    return focal, mean - focal * float(tangents.mean()), float(np.sqrt(np.mean(residual**2)))


def _drawn(points: _Points, colours: UInt8Array, topic: str) -> tuple[UInt8Array, Float32Array, Intrinsics]:
    """Pixels, depths [m] and optics of the picture into which a cloud without order is drawn."""
    depth = points.depth_m.ravel()
    with np.errstate(divide="ignore", invalid="ignore"):
        across, down = points.right_m.ravel() / depth, points.down_m.ravel() / depth
    seen = (depth > 0.0) & (depth < np.inf) & (np.abs(across) < _WIDEST) & (np.abs(down) < _WIDEST)  # NaN is not
    if np.count_nonzero(seen) < _LEAST_POINTS:
        raise HardwareError(
            f"the cloud {topic} has {np.count_nonzero(seen)} points in front of its camera; at least {_LEAST_POINTS} "
            "are needed: is the camera covered, or is the cloud in another frame than the camera's?"
        )
    across, down, depth = (one[seen].astype(np.float32) for one in (across, down, depth))
    focal = _focal_px(across, down)
    half_width, half_height = (int(np.ceil(float(np.abs(one).max()) * focal)) + 1 for one in (across, down))
    width, height = 2 * half_width, 2 * half_height
    cx, cy = half_width - 0.5, half_height - 0.5
    columns = np.rint(across * np.float32(focal) + np.float32(cx)).astype(np.int64)
    rows = np.rint(down * np.float32(focal) + np.float32(cy)).astype(np.int64)
    at = rows * width + columns
    nearest = np.full(height * width, np.inf, dtype=np.float32)
    np.minimum.at(nearest, at, depth)
    shown = depth == nearest[at]
    # A colour as one number is moved four times as fast.
    packed = np.asarray(cv2.cvtColor(colours, cv2.COLOR_RGB2RGBA)).view(np.uint32).ravel()
    drawn = np.zeros(height * width, dtype=np.uint32)
    drawn[at[shown]] = packed[seen][shown]
    pixels = cv2.cvtColor(drawn.view(np.uint8).reshape(height, width, 4), cv2.COLOR_RGBA2RGB)
    nearest[np.isinf(nearest)] = 0.0
    return np.asarray(pixels, dtype=np.uint8), nearest.reshape(height, width), (focal, focal, cx, cy)


def _focal_px(across: NDArray[np.float32], down: NDArray[np.float32]) -> float:
    """The longest focal length [px] at which the points, by their tangents (N,), leave no holes between them."""
    most = min(_FOCAL_PX[1], float(np.sqrt(_MOST_PIXELS / max(1e-6, 4.0 * np.abs(across).max() * np.abs(down).max()))))
    focal = _FOCAL_PX[0]
    # Holes are recognised at up to twice the right focal length: doubling first does not step over it.
    while focal * 2.0 <= most and _holes(across, down, focal * 2.0) <= _HOLES:
        focal *= 2.0
    while focal * _FINER <= most and _holes(across, down, focal * _FINER) <= _HOLES:
        focal *= _FINER
    return focal


def _holes(across: NDArray[np.float32], down: NDArray[np.float32], focal: float) -> float:
    """Fraction of the pixels of a drawn cloud that have no point, but points around them."""
    columns = np.rint((across - across.min()) * np.float32(focal)).astype(np.int64) + 2
    rows = np.rint((down - down.min()) * np.float32(focal)).astype(np.int64) + 2
    taken = np.zeros((int(rows.max()) + 3, int(columns.max()) + 3), dtype=np.uint8)
    taken[rows, columns] = 1
    closed = np.asarray(cv2.morphologyEx(taken, cv2.MORPH_CLOSE, np.ones((3, 3), dtype=np.uint8)))
    filled = np.count_nonzero(closed)
    return 1.0 - np.count_nonzero(taken) / filled
