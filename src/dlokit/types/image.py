"""Images, and the calibration of the camera that took them."""

import math

from dlokit.errors import BadValue
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import NORM_TOLERANCE, Pose

_FOCAL_OF_SIDE = (0.1, 100.0)
"""Focal lengths over the larger side of the picture: 157° and 0.6° wide. Those in millimetres or metres are outside."""
_LENSES = (4, 5, 8, 12, 14)
"""Numbers of distortion coefficients that OpenCV knows."""
_FARTHEST_M = 100.0
"""A camera farther from the world's origin than any hall is wide is given in millimetres."""
_WIDEST_BASELINE_M = 10.0
_LATEST_S = 10.0
"""Pictures that are later are of another moment altogether, or the number is in milliseconds."""
_LEAST_COSINE = 0.866
"""Of half the turn between a raw and a rectified picture: turned by more than 60° they show different things."""


class RawCamera(Value, frozen=True, kw_only=True, eq=False):
    """One camera of a pair that is not parallel, as it takes its pictures.

    Its centre is that of the same camera of the rectified pair. Raises `BadValue` where the quaternion's norm is not 1,
    or it turns by more than 60°; `CameraCalibration` checks the other values.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    wxyz: Float64Array  # (4,) turn of the camera in the rectified frame: p_rectified = R p_raw
    distortion: Float32Array  # (4, 5, 8, 12 or 14) in OpenCV's order: k1 k2 p1 p2 k3 ...

    def __post_init__(self) -> None:
        # NaN also fails the comparisons.
        if self.wxyz.shape != (4,) or not abs(float(self.wxyz @ self.wxyz) - 1.0) <= NORM_TOLERANCE:
            raise BadValue(f"the turn wxyz of a raw camera is {self.wxyz}; it must be a quaternion of norm 1")
        if abs(float(self.wxyz[0])) < _LEAST_COSINE:
            raise BadValue(f"the turn wxyz of a raw camera is {self.wxyz}; it must turn by at most 60°")


class CameraCalibration(Value, frozen=True, kw_only=True, eq=False):
    """Pinhole camera, or the left one of a rectified pair. Camera frame: x right, y down, z forward.

    Of a pair that is not parallel all of it is of the rectified pictures. Their frame has its origin in the centre of
    the left camera, and its x axis points to that of the right one; `raw_left` and `raw_right` say how to make them.

    Raises `BadValue`, which names the key, its value and what is allowed: every reader of a calibration checks it so.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    T_world_camera: Pose
    """Calibrated pose of the (left) camera; it differs slightly from the true pose."""
    baseline_m: float | None = None
    """Distance of the right camera along the left one's x axis [m]; None for a single camera."""
    distortion: Float32Array | None = None
    """(4, 5, 8, 12 or 14) coefficients of the left image in OpenCV's order, k1 k2 p1 p2 k3 ...; None when rectified."""
    distortion_right: Float32Array | None = None  # of the right image
    raw_left: RawCamera | None = None
    """The left camera of a pair that is not parallel; None: the pictures need no rectification but for distortion."""
    raw_right: RawCamera | None = None
    """Its right camera; given exactly where `raw_left` is."""
    serial: str = ""
    date: str = ""
    """Day of calibration, ISO 8601."""
    stamps_late_s: float = 0.0
    """By how much the driver's stamps are later than the exposures [s]; a run with the calibration corrects them."""

    def __post_init__(self) -> None:
        if (self.raw_left is None) != (self.raw_right is None):
            raise BadValue(
                "a calibration names raw_left or raw_right alone; it must name both cameras of a pair or none"
            )
        if self.raw_left is not None and not (self.distortion is None and self.distortion_right is None):
            raise BadValue("a calibration has raw_left and distortion; the distortion of each camera is in raw_left")
        if self.raw_left is not None and self.baseline_m is None:
            raise BadValue("a calibration has raw_left and no baseline_m; the pair that is made of it needs one")
        for name, size_px in (("width_px", self.width_px), ("height_px", self.height_px)):
            if size_px < 1:
                raise BadValue(f"{name} is {size_px}; it must be 1 or greater")
        _check_optics("", self, self)
        for name, raw in (("raw_left.", self.raw_left), ("raw_right.", self.raw_right)):
            if raw is not None:
                _check_optics(name, raw, self)
                _check_lens(f"{name}distortion", raw.distortion)
        _check_lens("distortion", self.distortion)
        _check_lens("distortion_right", self.distortion_right)
        if self.baseline_m is not None:
            _check_within(
                "baseline_m", self.baseline_m, 1e-3, _WIDEST_BASELINE_M, "metres, and None of a single camera"
            )
        _check_within("stamps_late_s", self.stamps_late_s, -_LATEST_S, _LATEST_S, "seconds")
        for number, value in enumerate(self.T_world_camera.position_m.tolist()):
            _check_within(f"T_world_camera.position_m[{number}]", value, -_FARTHEST_M, _FARTHEST_M, "metres")


def _check_within(name: str, value: float, least: float, most: float, unit: str) -> None:
    if not least <= value <= most:  # NaN is not
        raise BadValue(f"{name} is {value:g}; it must be {least:g} to {most:g}, in {unit}")


def _check_optics(name: str, of: "RawCamera | CameraCalibration", camera: CameraCalibration) -> None:
    """Refuse focal lengths and a principal point with which no lens makes pictures of that size."""
    side_px = max(camera.width_px, camera.height_px)
    least_px, most_px = (factor * side_px for factor in _FOCAL_OF_SIDE)
    for key, focal_px in (("fx_px", of.fx_px), ("fy_px", of.fy_px)):
        _check_within(name + key, focal_px, least_px, most_px, "pixels")
    # A picture may be a part of what the lens shows, as far beside its middle as the part is wide.
    for key, centre_px, size_px in (("cx_px", of.cx_px, camera.width_px), ("cy_px", of.cy_px, camera.height_px)):
        _check_within(name + key, centre_px, -size_px, 2.0 * size_px, f"pixels of a picture of {size_px}")


def _check_lens(name: str, coefficients: Float32Array | None) -> None:
    if coefficients is None:
        return
    if coefficients.ndim != 1 or len(coefficients) not in _LENSES:
        count = coefficients.size if coefficients.ndim == 1 else f"the shape {coefficients.shape} of"
        raise BadValue(f"{name} has {count} numbers; it must have {', '.join(map(str, _LENSES))} in a row")
    if not all(map(math.isfinite, coefficients.tolist())):
        raise BadValue(f"{name} is {coefficients.tolist()}; each coefficient must be a finite number")


class Image(Message, frozen=True, kw_only=True, eq=False):
    """One image."""

    pixels: UInt8Array  # (height, width, 3) RGB or (height, width) grey


class StereoImages(Message, frozen=True, kw_only=True, eq=False):
    """A pair of images exposed at the same time."""

    left: UInt8Array  # (height, width, 3) RGB
    right: UInt8Array  # (height, width, 3) RGB
    calibration: CameraCalibration

    @property
    def reference(self) -> UInt8Array:
        """The picture of the camera that `calibration` describes: the left one (height, width, 3)."""
        return self.left


class DepthImage(Message, frozen=True, kw_only=True, eq=False):
    """An image with the depth of each pixel, from a depth camera."""

    pixels: UInt8Array  # (height, width, 3) RGB
    depth_m: Float32Array  # (height, width) along z of the camera [m]; 0 where unknown
    calibration: CameraCalibration

    @property
    def reference(self) -> UInt8Array:
        """The picture of the camera that `calibration` describes (height, width, 3)."""
        return self.pixels


CameraPictures = StereoImages | DepthImage
"""What a camera gives: a pair to be matched, or a colour image with its depth."""


class Mask(Value, frozen=True, kw_only=True, eq=False):
    """The pixels that show the DLO."""

    pixels: BoolArray  # (height, width)


class CameraCheck(Value, frozen=True, kw_only=True, eq=False):
    """Measured error of the camera's calibrated pose in the table plane, with its uncertainty."""

    offset_m: Float64Array  # (2,) x, y [m] from the calibrated to the measured position
    yaw_rad: float
    """Rotation error about the vertical axis through `center_world` [rad]."""
    center_world: Float64Array  # (2,) x, y [m]
    """Point on the table to which offset and rotation refer: the centre of the observed region."""
    scatter_m: float
    """Remaining deviation between the images after the correction (root mean square) [m]."""
    points: int
    """Number of detected points on the arm's outline."""
