"""What a look at the robot's own hand says of where the camera stands."""

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Value


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
