"""The observer's skills."""

from dlokit.communication.skill import Skill
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import TargetPoints
from dlokit.types.system import StrategySpec


def _initialise(after_stamp_ns: int = 0, towards_world: Float64Array | None = None) -> TargetPoints:
    """Order a cloud into nodes with no prior, and publish them as targets.

    Takes the newest cloud, or waits for the next one when that is older than `after_stamp_ns`. Node 0 is the
    end farther to the robot's left (larger y in the world; of two ends within 2 cm, the smaller x), unless
    the rod was observed before: then the order stays. With `towards_world` (K, 3) [m] node 0 is the end that
    makes the rod's order the nearer one to that curve. Fails with: no_cloud (none came), no_points,
    out_of_view (an end is cut off), crossing (the rod lies across itself in more than one possible order), fragmented.
    """
    ...


def _set_strategy(spec: StrategySpec) -> None:
    """Estimate with another strategy from the next cloud on. Rejects: unknown_strategy, bad_settings."""
    ...


def _reset() -> None:
    """Forget the rod: clouds are ignored until the next `INITIALISE`, which chooses the order again."""
    ...


INITIALISE = Skill(
    "observer",
    "initialise",
    _initialise,
    timeout_s=10.0,
    requires="the rod lies in view",
    ensures="the targets are published, with the stamp of the cloud; every later cloud gives targets",
)
SET_STRATEGY = Skill("observer", "set_strategy", _set_strategy, timeout_s=5.0)
RESET = Skill("observer", "reset", _reset, timeout_s=5.0)
