"""A pose: where a frame stands in another."""

import math

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Value

NORM_TOLERANCE = 1e-3
"""Largest distance of a quaternion's norm from 1: four numbers typed with three decimals are off by as much. Arithmetic
stays 12 orders of magnitude below."""
_NORM_SQUARED = ((1.0 - NORM_TOLERANCE) ** 2, (1.0 + NORM_TOLERANCE) ** 2)


class Pose(Value, frozen=True, kw_only=True, eq=False):
    """A rigid transform. ``T_world_tcp: Pose`` means ``p_world = T_world_tcp @ p_tcp``.

    Raises `BadValue` where the position is not finite or the quaternion's norm is not 1 within `NORM_TOLERANCE`.
    """

    position_m: Float64Array  # (3,) [m]
    wxyz: Float64Array  # (4,) unit quaternion, scalar first

    def __post_init__(self) -> None:
        # A plan makes thousands of poses: plain floats take 1 µs, NumPy's functions 10.
        if self.position_m.shape != (3,) or self.wxyz.shape != (4,):
            raise BadValue(
                f"a pose has a position of shape {self.position_m.shape} and a quaternion of shape {self.wxyz.shape}; "
                "allowed are (3,) and (4,)"
            )
        x, y, z = self.position_m.tolist()
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            raise BadValue(f"a pose's position_m is {self.position_m}; give three finite numbers in metres")
        a, b, c, d = self.wxyz.tolist()
        # NaN fails the comparison too.
        if not _NORM_SQUARED[0] <= a * a + b * b + c * c + d * d <= _NORM_SQUARED[1]:
            raise BadValue(
                f"a pose's quaternion wxyz is {self.wxyz}; its norm must be 1 within {NORM_TOLERANCE}: "
                "geometry.pose normalises it"
            )
