"""Settings of the observer component."""

from dataclasses import dataclass, field

from dlokit.skills.observer.initialise.first_shape import InitialiseConfig
from dlokit.skills.observer.map.observer import MapConfig
from dlokit.skills.observer.strategies import Observer


@dataclass(frozen=True, kw_only=True)
class ObserverConfig:
    """From points to target points."""

    strategy: Observer = field(default_factory=MapConfig)
    """How nodes are found in a cloud, given where they were."""
    initialise: InitialiseConfig = field(default_factory=InitialiseConfig)
    """How the first cloud is ordered."""
    lost_health: float = 0.75
    """Below this health the rod may be lost: the cloud is ordered anew, in the direction the rod had."""
    sound_health: float = 0.8
    """A lost rod counts as found again from this health on; above `lost_health`, so that one whose health wavers is not
    told of again and again."""
    elsewhere_m: float = 0.01
    """A cloud ordered anew is preferred where it differs from the targets by more than this [m], root mean square."""
    found_again_health: float = 0.5
    """Targets of a rod that was lost and found again have at most this health."""
    hopeless_health: float = 0.25
    """Targets of less health are not used: the last state is kept, unseen and less and less certain."""
    most_points: int = 20_000
    """A larger cloud is thinned to so many points, drawn evenly."""
    least_points: int = 10
    """Fewer points than this tell nothing."""
    reach_m: float = 1.0
    """Points farther than this from where the rod was are not its own [m]; a cloud of which most are is refused."""
    drift_m_s: float = 0.2
    """How fast a rod may move that is not seen: its nodes' standard deviation grows by so much a second [m/s]."""
    cloud_timeout_s: float = 5.0
    """Longest wait for a cloud to start from [s]."""
