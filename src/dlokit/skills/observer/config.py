"""Settings of the observer component."""

from dataclasses import dataclass, field

from dlokit.ranges import Fraction, NotNegative, Positive, check_ranges
from dlokit.skills.observer.map.observer import MapConfig
from dlokit.skills.observer.strategies import Observer


@dataclass(frozen=True, kw_only=True)
class ObserverConfig:
    """From points to target points."""

    strategy: Observer = field(default_factory=MapConfig)
    """Strategy that estimates the nodes from a cloud and the previous nodes."""
    lost_health: Fraction = 0.75
    """Health below which the rod counts as lost; the cloud is then ordered again without a prior. Larger: a doubtful
    estimate is replaced earlier."""
    reach_m: Positive = 1.0
    """Points farther from the last shape than this are not used [m]; a cloud with mostly far points is rejected."""
    drift_m_s: NotNegative = 0.2
    """Assumed speed of an unseen rod [m/s]: the standard deviation of its nodes grows at this rate."""
    cloud_timeout_s: Positive = 5.0
    """Longest wait for a first cloud [s]."""

    def __post_init__(self) -> None:
        check_ranges(self, "observer")
