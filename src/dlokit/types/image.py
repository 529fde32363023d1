"""Images, and the calibration of the camera that took them."""

import numpy as np

from dlokit.errors import BadValue
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import NORM_TOLERANCE, Pose


class RawCamera(Value, frozen=True, kw_only=True, eq=False):
    """One camera of a pair that is not parallel, before rectification.

    It has the same centre as in the rectified pair. Raises `BadValue` if the quaternion's norm is not 1 or
    its rotation exceeds 60°; `CameraCalibration` checks the other values.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    wxyz: Float64Array  # (4,) rotation of the camera in the rectified frame: p_rectified = R p_raw
    distortion: Float32Array  # (4, 5, 8, 12 or 14) in OpenCV's order: k1 k2 p1 p2 k3 ...

    def __post_init__(self) -> None:
        # NaN also fails the comparisons.
        norm = float(self.wxyz @ self.wxyz) if self.wxyz.shape == (4,) else 0.0
        if not abs(norm - 1.0) <= NORM_TOLERANCE or abs(float(self.wxyz[0])) < np.cos(np.radians(30.0)):
            raise BadValue(
                f"the rotation wxyz of a raw camera is {self.wxyz}; it must be a quaternion of norm 1, of at most 60°"
            )


class CameraCalibration(Value, frozen=True, kw_only=True, eq=False):
    """Pinhole camera, or the left one of a rectified pair. Camera frame: x right, y down, z forward.

    For a pair that is not parallel, all values refer to the rectified pictures. Their frame has its origin in the
    centre of the left camera, and its x axis points to the centre of the right one; `raw_left` and `raw_right` define
    the rectification.

    Raises `BadValue`, which names the key, its value and the allowed range: every reader of a calibration checks it.
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
    """The right camera of that pair; set if and only if `raw_left` is."""
    serial: str = ""
    date: str = ""
    """Day of calibration, ISO 8601."""
    stamps_late_s: float = 0.0
    """Delay of the driver's stamps after the exposures [s]; a run with the calibration corrects it."""

    def __post_init__(self) -> None:
        if (self.raw_left is None) != (self.raw_right is None):
            raise BadValue("a calibration has raw_left or raw_right alone; it must have both or neither")
        if self.raw_left is not None and not (self.distortion is None and self.distortion_right is None):
            raise BadValue("a calibration has raw_left and distortion; the distortion of each camera is in raw_left")
        if self.raw_left is not None and self.baseline_m is None:
            raise BadValue("a calibration has raw_left and no baseline_m; a rectified pair needs baseline_m")
        self._check_values()

    def _check_values(self) -> None:
        width_px, height_px, side_px = self.width_px, self.height_px, max(self.width_px, self.height_px)
        cameras = {"": self, "raw_left.": self.raw_left, "raw_right.": self.raw_right}
        # Other lengths and times are in millimetres and milliseconds.
        ranges = [("width_px", width_px, 1, np.inf), ("height_px", height_px, 1, np.inf)]
        ranges += [("baseline_m", 0.1 if self.baseline_m is None else self.baseline_m, 1e-3, 10.0)]
        ranges += [("stamps_late_s", self.stamps_late_s, -10.0, 10.0)]
        ranges += [("T_world_camera.position_m", value, -100.0, 100.0) for value in self.T_world_camera.position_m]
        for name, one in cameras.items():
            if one is not None:
                # Angles of view from 157° to 0.6°. A picture may be cut out of a larger one, up to its own width off
                # the centre.
                ranges += [(f"{name}fx_px", one.fx_px, 0.1 * side_px, 100.0 * side_px)]
                ranges += [(f"{name}fy_px", one.fy_px, 0.1 * side_px, 100.0 * side_px)]
                ranges += [(f"{name}cx_px", one.cx_px, -width_px, 2.0 * width_px)]
                ranges += [(f"{name}cy_px", one.cy_px, -height_px, 2.0 * height_px)]
        for name, value, least, most in ranges:
            if not least <= value <= most:  # NaN is not
                raise BadValue(f"{name} is {value:g}; it must be {least:g} to {most:g}")
        lenses = {f"{name}distortion": one and one.distortion for name, one in cameras.items()}
        for name, lens in (*lenses.items(), ("distortion_right", self.distortion_right)):
            # The numbers of coefficients of OpenCV's lens models.
            if lens is not None and (lens.shape not in {(4,), (5,), (8,), (12,), (14,)} or not np.isfinite(lens).all()):
                raise BadValue(f"{name} is {lens.tolist()}; it must be a row of 4, 5, 8, 12 or 14 finite numbers")


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
"""The output of a camera: a stereo pair to match, or a colour image with its depth."""


class Mask(Value, frozen=True, kw_only=True, eq=False):
    """The pixels that show the DLO."""

    pixels: BoolArray  # (height, width)


class SegmentedPicture(Value, frozen=True, kw_only=True, eq=False):
    """A picture, perhaps made smaller, and how much of each of its pixels a segmentation takes for DLO."""

    pixels: UInt8Array  # (height, width, 3) RGB
    used: UInt8Array  # (height, width) 0 to 255: DLO
    dropped: UInt8Array  # (height, width) 0 to 255: segmented, but outside the box, on a robot, or in too small a patch
    fraction: float
    """Fraction of the pixels that are used, 0 to 1."""
    problem: str = ""
    """Why a look at this picture would fail; empty if it would not."""


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
