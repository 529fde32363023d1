"""Settings of the observer component."""

from dataclasses import dataclass, field

from dlokit.skills.observer.anchored import AnchoredConfig
from dlokit.skills.observer.initialise import InitialiseConfig
from dlokit.skills.observer.strategies import Observer


@dataclass(frozen=True, kw_only=True)
class ObserverConfig:
    """From points to target points."""

    strategy: Observer = field(default_factory=AnchoredConfig)
    """How nodes are found in a cloud, given where they were."""
    initialise: InitialiseConfig = field(default_factory=InitialiseConfig)
    """How the first cloud is ordered."""
    lost_health: float = 0.75
    """Below this health the rod may be lost: the cloud is ordered anew, in the direction the rod had."""
    elsewhere_m: float = 0.01
    """A cloud ordered anew is preferred where it differs from the targets by more than this [m], root mean square."""
    found_again_health: float = 0.5
    """Targets of a rod that was lost and found again have at most this health."""
    cloud_timeout_s: float = 5.0
    """Longest wait for a cloud to start from [s]."""
