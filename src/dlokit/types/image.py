"""Images, and the calibration of the camera that took them."""

from dlokit.errors import BadValue
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import NORM_TOLERANCE, Pose


class RawCamera(Value, frozen=True, kw_only=True, eq=False):
    """One camera of a pair that is not parallel, as it takes its pictures.

    Its centre is that of the same camera of the rectified pair. Raises `BadValue` where the quaternion's norm is not 1.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    wxyz: Float64Array  # (4,) turn of the camera in the rectified frame: p_rectified = R p_raw
    distortion: Float32Array  # (5,) k1 k2 p1 p2 k3

    def __post_init__(self) -> None:
        if self.wxyz.shape != (4,) or abs(float(self.wxyz @ self.wxyz) - 1.0) > NORM_TOLERANCE:
            raise BadValue(f"the turn wxyz of a raw camera is {self.wxyz}; it must be a quaternion of norm 1")


class CameraCalibration(Value, frozen=True, kw_only=True, eq=False):
    """Pinhole camera, or the left one of a rectified pair. Camera frame: x right, y down, z forward.

    Of a pair that is not parallel all of it is of the rectified pictures. Their frame has its origin in the centre of
    the left camera, and its x axis points to that of the right one; `raw_left` and `raw_right` say how to make them.
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
    distortion: Float32Array | None = None  # (5,) k1 k2 p1 p2 k3 of the left image; None when rectified
    distortion_right: Float32Array | None = None  # (5,) of the right image
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
