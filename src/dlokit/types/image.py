"""Pictures, and what is known of the camera that took them."""

from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import Pose


class CameraCalibration(Value, frozen=True, kw_only=True, eq=False):
    """Pinhole camera, or the left one of a rectified pair. Camera frame: x right, y down, z forward."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    T_world_camera: Pose
    """Where the (left) camera is believed to stand; a real one is always a little off."""
    baseline_m: float | None = None
    """Distance of the right camera along the left one's x axis [m]; None for a single camera."""
    distortion: Float32Array | None = None  # (5,) k1 k2 p1 p2 k3 of the left picture; None when rectified
    distortion_right: Float32Array | None = None  # (5,) of the right picture
    serial: str = ""
    date: str = ""
    """Day of calibration, ISO 8601."""


class Image(Message, frozen=True, kw_only=True, eq=False):
    """One picture."""

    pixels: UInt8Array  # (height, width, 3) RGB or (height, width) grey


class StereoImages(Message, frozen=True, kw_only=True, eq=False):
    """Two pictures exposed together."""

    left: UInt8Array  # (height, width, 3) RGB
    right: UInt8Array  # (height, width, 3) RGB
    calibration: CameraCalibration


class DepthImage(Message, frozen=True, kw_only=True, eq=False):
    """A picture with the depth of each pixel, as depth cameras give it."""

    pixels: UInt8Array  # (height, width, 3) RGB
    depth_m: Float32Array  # (height, width) along z of the camera [m]; 0 where unknown
    calibration: CameraCalibration


class Mask(Value, frozen=True, kw_only=True, eq=False):
    """Which pixels are DLO."""

    pixels: BoolArray  # (height, width)


class CameraCheck(Value, frozen=True, kw_only=True, eq=False):
    """How far the camera is seen to be off its believed place along the table, and how well that is known."""

    offset_m: Float64Array  # (2,) x, y [m] from the believed place to the seen one
    yaw_rad: float
    """How far it is turned about the vertical through the middle of what was looked at [rad]."""
    center_world: Float64Array  # (2,) x, y [m]
    """The point on the table that the offset is told of, and the turn is about."""
    scatter_m: float
    """How far the pictures disagree after the correction (root mean square) [m]."""
    points: int
    """Points of the arm's outline that were found."""
