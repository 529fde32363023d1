"""Calibrations of ROS 2 cameras (`sensor_msgs/msg/CameraInfo`), of one camera or of a stereo pair.

As in ROS, the frame of a stereo pair's left camera is that of its rectified pictures. Every function raises
`HardwareError`: what was found, what is taken, what to do.
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from dlokit.errors import BadValue, HardwareError
from dlokit.geometry.camera import intrinsics
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.image import CameraCalibration, RawCamera
from dlokit.types.pose import Pose

_TRANSPORTS = ("/compressed", "/compressedDepth")
_LENSES = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14)}
"""Models whose coefficients are OpenCV's, in its order, with the possible numbers of them."""
_ROWS_PX = 0.1
"""Largest difference of two rectified cameras' optics [px]; stereo matching resolves a sixteenth of a pixel."""

Intrinsics = tuple[float, float, float, float]
"""fx, fy, cx, cy [px]."""


@dataclass(frozen=True, kw_only=True)
class InfoOf:
    """A CameraInfo and the pictures that it describes."""

    message: Any
    topic: str
    """Its topic."""
    pictures: str
    """The topic of its pictures."""
    size_px: tuple[int, int]
    """Width and height of its pictures."""


def info_topic(pictures: str) -> str:
    """The topic `camera_info` beside a topic of pictures, e.g. ``/cam/camera_info`` of ``/cam/image/compressed``."""
    return without_transport(pictures).rpartition("/")[0] + "/camera_info"


def without_transport(pictures: str) -> str:
    """A topic of pictures without the suffix of a compressed one."""
    for suffix in _TRANSPORTS:
        pictures = pictures.removesuffix(suffix)
    return pictures


def is_rectified(pictures: str) -> bool:
    """Whether a topic has rectified pictures by its name, e.g. ``image_rect`` or ``rect/image``."""
    words = re.split(r"[/_]", "/".join(without_transport(pictures).split("/")[-2:]))
    return "rect" in words or "rectified" in words


def calibration_of(info: InfoOf, T_world_camera: Pose) -> CameraCalibration:
    """The calibration of one camera; that of rectified pictures has no distortion."""
    if is_rectified(info.pictures):
        return _calibration(info, rectified_intrinsics(info), T_world_camera)
    return _calibration(info, _raw_intrinsics(info), T_world_camera, distortion=_distortion(info))


def pair_calibration_of(left: InfoOf, right: InfoOf, T_world_camera: Pose) -> CameraCalibration:
    """The calibration of a stereo pair, rectified or raw; `T_world_camera` is the left rectified camera's pose."""
    if left.size_px != right.size_px:
        raise HardwareError(
            f"the left pictures of {left.pictures} are {_size(left.size_px)}, the right ones of {right.pictures} "
            f"{_size(right.size_px)}; both must have one size: set the camera's driver so"
        )
    ideal, baseline_m = _rectified_pair(left, right)
    if is_rectified(left.pictures) and is_rectified(right.pictures):
        return _calibration(left, ideal, T_world_camera, baseline_m=baseline_m)
    if is_rectified(left.pictures) or is_rectified(right.pictures):
        raise HardwareError(
            f"one of {left.pictures} and {right.pictures} is rectified, the other is not; name two rectified topics, "
            "or two raw ones"
        )
    return _calibration(
        left, ideal, T_world_camera, baseline_m=baseline_m, raw_left=_raw_camera(left), raw_right=_raw_camera(right)
    )


def _rectified_pair(left: InfoOf, right: InfoOf) -> tuple[Intrinsics, float]:
    ideal, other = rectified_intrinsics(left), rectified_intrinsics(right)
    if not np.allclose(ideal, other, rtol=0.0, atol=_ROWS_PX):
        raise HardwareError(
            f"the rectified cameras of {left.topic} and {right.topic} differ in P: fx, fy, cx, cy are "
            f"{_numbers(ideal)} and {_numbers(other)} px; they must be equal: calibrate the pair with zero disparity "
            "at infinity, as camera_calibration does"
        )
    shift_m = [-float(one.message.p[3]) / float(one.message.p[0]) for one in (left, right)]
    baseline_m = shift_m[1] - shift_m[0]
    if baseline_m < 0.0:
        raise HardwareError(
            f"left and right are exchanged: by P of {right.topic} its camera is {-baseline_m:.3f} m on the left of "
            f"that of {left.topic}; exchange --camera.colour and --camera.right"
        )
    if baseline_m == 0.0:
        raise HardwareError(
            f"{right.topic} has no baseline: P[3] is 0, and it must be −fx times the distance of the cameras in "
            "metres; calibrate the pair together (camera_calibration with two cameras), or use the driver's own "
            "calibration"
        )
    return ideal, baseline_m


def rectified_intrinsics(info: InfoOf) -> Intrinsics:
    """fx, fy, cx, cy [px] of rectified pictures, from P."""
    P = np.asarray(info.message.p, dtype=np.float64).reshape(3, 4)
    return _of_picture(info, P[:, :3], "P")


def _raw_intrinsics(info: InfoOf) -> Intrinsics:
    return _of_picture(info, np.asarray(info.message.k, dtype=np.float64).reshape(3, 3), "K")


def _of_picture(info: InfoOf, K: Float64Array, name: str) -> Intrinsics:
    """Intrinsics of the pictures, which may be a part of the sensor's (roi), with several pixels as one (binning)."""
    message = info.message
    if not K.any():
        raise HardwareError(
            f"the camera is not calibrated in ROS: {name} of {info.topic} is all 0; calibrate it (`ros2 run "
            "camera_calibration cameracalibrator`), or set the driver to publish its own calibration"
        )
    try:
        fx, fy, cx, cy = intrinsics(K)
    except BadValue as error:
        raise HardwareError(f"{name} of {info.topic} cannot be used: {error}") from error
    part = message.roi
    across, down = max(1, message.binning_x), max(1, message.binning_y)
    size_px = (part.width or message.width) // across, (part.height or message.height) // down
    if size_px != info.size_px:
        raise HardwareError(
            f"the pictures of {info.pictures} are {_size(info.size_px)}, their calibration {info.topic} is for "
            f"{_size(size_px)}; name the pictures that it is for, or set the driver to publish that of this size"
        )
    # The centre of the first of several pixels is at 0, that of the pixel made of them at (number - 1) / 2.
    left, top = part.x_offset + (across - 1) / 2.0, part.y_offset + (down - 1) / 2.0
    return fx / across, fy / down, (cx - left) / across, (cy - top) / down


def _distortion(info: InfoOf) -> Float32Array | None:
    """OpenCV's coefficients; None without distortion."""
    model, lens = info.message.distortion_model, np.asarray(info.message.d, dtype=np.float32)
    numbers = _LENSES.get(model)
    if not lens.any() and (numbers is not None or not model):
        return None
    if numbers is None or len(lens) not in numbers:
        taken = " and ".join(f"{name} ({', '.join(map(str, many))} numbers)" for name, many in _LENSES.items())
        raise HardwareError(
            f"{info.topic} has the distortion {model!r} of {len(lens)} numbers; taken are {taken}: name a rectified "
            "topic (image_proc makes one), or calibrate the camera with one of these models"
        )
    return lens


def _raw_camera(info: InfoOf) -> RawCamera:
    fx_px, fy_px, cx_px, cy_px = _raw_intrinsics(info)
    R = np.asarray(info.message.r, dtype=np.float64).reshape(3, 3)
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0.0:  # three decimals are enough
        raise HardwareError(
            f"R of {info.topic} is {R.tolist()}, which is no rotation; calibrate the pair together "
            "(camera_calibration with two cameras), or name two rectified topics"
        )
    lens = _distortion(info)
    try:
        return RawCamera(
            fx_px=fx_px,
            fy_px=fy_px,
            cx_px=cx_px,
            cy_px=cy_px,
            wxyz=scipy.spatial.transform.Rotation.from_matrix(R).as_quat(scalar_first=True, canonical=True),
            distortion=np.zeros(5, dtype=np.float32) if lens is None else lens,
        )
    except BadValue as error:
        raise HardwareError(f"{info.topic} cannot be used: {error}") from error


def _calibration(
    info: InfoOf,
    optics: Intrinsics,
    T_world_camera: Pose,
    *,
    baseline_m: float | None = None,
    distortion: Float32Array | None = None,
    raw_left: RawCamera | None = None,
    raw_right: RawCamera | None = None,
) -> CameraCalibration:
    try:
        return CameraCalibration(
            width_px=info.size_px[0],
            height_px=info.size_px[1],
            fx_px=optics[0],
            fy_px=optics[1],
            cx_px=optics[2],
            cy_px=optics[3],
            T_world_camera=T_world_camera,
            baseline_m=baseline_m,
            distortion=distortion,
            raw_left=raw_left,
            raw_right=raw_right,
        )
    except BadValue as error:
        raise HardwareError(f"{info.topic} cannot be used: {error}; calibrate the camera of {info.pictures}") from error


def _size(size_px: tuple[int, int]) -> str:
    return f"{size_px[0]} by {size_px[1]} px"


def _numbers(values: Intrinsics) -> str:
    return ", ".join(f"{value:.1f}" for value in values)
