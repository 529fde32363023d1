"""A pose: where a frame stands in another."""

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Value


class Pose(Value, frozen=True, kw_only=True, eq=False):
    """A rigid transform. ``T_world_tcp: Pose`` means ``p_world = T_world_tcp @ p_tcp``."""

    position_m: Float64Array  # (3,) [m]
    wxyz: Float64Array  # (4,) unit quaternion, scalar first
