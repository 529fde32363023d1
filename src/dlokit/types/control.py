"""Shape servoing: small motions of a held node, and the word on whether to go on."""

import enum

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Value
from dlokit.types.pose import Pose


class HeldNode(Value, frozen=True, kw_only=True, eq=False):
    """A node between fingers."""

    node: int
    T_world_tcp: Pose
    """The tool that holds it."""


class Correction(Value, frozen=True, kw_only=True, eq=False):
    """A small motion of the tool while it holds the DLO, and what the model expects of it."""

    displacement: Float64Array  # (4,) x, y, z [m] and yaw [rad] of the tool, in the world
    released_world: Float64Array  # (M, 3) [m] the shape expected if the DLO were let go before it
    predicted_world: Float64Array  # (M, 3) [m] the shape expected if it is let go after it


class ControlForecast(Value, frozen=True, kw_only=True):
    """Whether control shall follow an action, by what is known before it."""

    follows: bool
    gain_m: float
    """RMSE that control is expected to mend [m]; what the eye could feign does not count."""


class ControlVerdict(enum.Enum):
    """Whether control can still bring the shape nearer to its goal."""

    CORRECT = "correct"
    """It can: do the correction, then look again."""
    SETTLED = "settled"
    """The shape is good enough, or too little is to be gained at this grasp: let go."""
    DEADLOCK = "deadlock"
    """The error is not small and control cannot reduce it: let go, and plan another grasp."""


class ControlAdvice(Value, frozen=True, kw_only=True, eq=False):
    """What to do with a DLO that is held."""

    verdict: ControlVerdict
    reason: str
    """Why not to go on, by name: good_enough, no_gain, in_doubt, badly_seen; no_progress, overstretch, out_of_reach.
    Empty when a correction is advised."""
    rmse_m: float
    """Error to the goal expected if the DLO were let go now [m]."""
    then_rmse_m: float
    """The same after the correction [m]; without one, the same as `rmse_m`."""
    target: Pose
    """Where the tool goes; where it is, when no correction is advised."""
    correction: Correction | None = None
