"""What perception can be asked to do."""

from dlokit.communication.contract import Condition
from dlokit.communication.skill import Skill
from dlokit.types.arrays import Float64Array
from dlokit.types.observation import Observation
from dlokit.types.strategy import StrategySpec


def _look() -> Observation:
    """Take one pair of pictures, find the DLO's points, publish both; returns the points.

    Fails with: camera_lost (no pictures in time), no_points (nothing left after segmentation and filters; the
    observation without points is published all the same).
    """
    ...


def _set_box(lower_world: Float64Array, upper_world: Float64Array) -> None:
    """Look only into the box from `lower_world` (3,) to `upper_world` (3,) [m], from the next look on.

    Rejected with: bad_box.
    """
    ...


def _set_segmentation(spec: StrategySpec) -> None:
    """Segment by another strategy, or by other settings, from the next look on.

    Rejected with: unknown_strategy (not installed), bad_settings (unknown, or out of range).
    """
    ...


def _set_tracking(rate_hz: float) -> None:
    """Look `rate_hz` times a second from now on; 0 stops it. A look that is due during another is left out.

    Rejected with: bad_rate.
    """
    ...


LOOK = Skill("perception", "look", _look, timeout_s=10.0, ensures="a new observation is published")
SET_BOX = Skill("perception", "set_box", _set_box, timeout_s=1.0, requires="lower below upper in each coordinate")
SET_SEGMENTATION = Skill(
    "perception", "set_segmentation", _set_segmentation, timeout_s=1.0, requires="the strategy is installed"
)
SET_TRACKING = Skill(
    "perception",
    "set_tracking",
    _set_tracking,
    timeout_s=1.0,
    requires=(Condition("rate_hz is 0 (off) to 60 Hz", "bad_rate", lambda rate_hz: 0.0 <= rate_hz <= 60.0),),
)
