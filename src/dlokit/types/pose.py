"""Poses: position and orientation of one frame in another."""

import math

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Value

NORM_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's norm from 1, enough for values typed with three decimals; arithmetic errors are
12 orders of magnitude smaller."""
_NORM_SQUARED = ((1.0 - NORM_TOLERANCE) ** 2, (1.0 + NORM_TOLERANCE) ** 2)


class Pose(Value, frozen=True, kw_only=True, eq=False):
    """A rigid transform. ``T_world_tcp: Pose`` means ``p_world = T_world_tcp @ p_tcp``.

    Raises `BadValue` if the position is not finite or the quaternion's norm is not 1 within `NORM_TOLERANCE`.
    """

    position_m: Float64Array  # (3,) [m]
    wxyz: Float64Array  # (4,) unit quaternion, scalar first

    def __post_init__(self) -> None:
        # A planner creates thousands of poses: the check takes 1 µs with Python floats, 10 µs with NumPy functions.
        if self.position_m.shape != (3,) or self.wxyz.shape != (4,):
            raise BadValue(
                f"a pose has a position of shape {self.position_m.shape} and a quaternion of shape {self.wxyz.shape}; "
                "the shapes must be (3,) and (4,)"
            )
        x, y, z = self.position_m.tolist()
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            raise BadValue(f"a pose's position_m is {self.position_m}; give three finite numbers in metres")
        a, b, c, d = self.wxyz.tolist()
        # NaN also fails the comparison.
        if not _NORM_SQUARED[0] <= a * a + b * b + c * c + d * d <= _NORM_SQUARED[1]:
            raise BadValue(
                f"a pose's quaternion wxyz is {self.wxyz}; its norm must be 1 within {NORM_TOLERANCE}: "
                "geometry.pose normalises it"
            )
