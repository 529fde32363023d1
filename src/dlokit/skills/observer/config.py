"""The observers to choose from, dlokit's, of the entry points ``dlokit.observers`` and the caller's, and settings."""

import copy
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Protocol, get_args

import numpy as np
import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.errors import ConfigError
from dlokit.ranges import Fraction, NotNegative, Positive, check_ranges
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import AnchoredConfig
from dlokit.skills.observer.base import ObserverStrategy, ObserverStrategyConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.map.observer import MapConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

OurObserver = MapConfig | AnchoredConfig | CpdConfig | SprConfig | SomConfig
"""Strategies that ship with dlokit, the default first; they are listed only here."""

OURS: tuple[type[OurObserver], ...] = get_args(OurObserver)

OBSERVERS: StrategyKind[ObserverStrategyConfig] = StrategyKind("observer", "dlokit.observers", OURS)

Observer = Annotated[ObserverStrategyConfig, OBSERVERS, tyro.conf.arg(constructor_factory=OBSERVERS.union)]
"""The settings of any installed observer: a choice on the command line and in configuration files."""

strategies = OBSERVERS.installed
to_spec = OBSERVERS.to_spec
from_spec = OBSERVERS.from_spec


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


class OwnObserver(Protocol):
    """The interface of a caller's observer; it may keep a state from cloud to cloud."""

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints | Float64Array:
        """The nodes in the order of the prior: an array (M, 3) [m], or targets with visibility and health.

        `seen.points_world` (N, 3) [m] is the cloud, `prior.nodes_world` (M, 3) [m] are the previous nodes.
        """
        ...


class Adapted:
    """Adapts an `OwnObserver` to the protocol of strategies."""

    def __init__(self, observer: OwnObserver) -> None:
        """The object itself is used, not a copy."""
        self._observer = observer

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """Targets; where the object gives an array, all nodes count as visible and the health is 1."""
        answer = self._observer.estimate(seen, prior)
        if isinstance(answer, TargetPoints):
            return answer
        nodes = np.asarray(answer, dtype=np.float64)
        if nodes.shape != prior.nodes_world.shape:
            raise ValueError(
                f"estimate of {type(self._observer).__name__} returned an array {nodes.shape}; needed are the nodes "
                f"{prior.nodes_world.shape} in metres, in the order of the prior"
            )
        return TargetPoints(stamp_ns=seen.stamp_ns, nodes_world=nodes, visible=np.ones(len(nodes), dtype=np.bool_))


def own_observer(called: str, observer: Any) -> type[ObserverStrategyConfig]:
    """Make a settings class that registers an object as the observer `called`.

    The object has ``estimate(seen, prior)``, or holds the settings of a strategy, e.g. ``CpdConfig(...)``. Each user
    gets a copy, so that the object may keep a state from cloud to cloud. Raises `ConfigError` for any other object.
    """
    if isinstance(observer, type) or not (hasattr(observer, "estimate") or hasattr(observer, "build")):
        raise ConfigError(
            f"observer {called!r} is {observer!r}; give an object with estimate(seen, prior), the settings of an "
            "observer, or the name of one that is installed."
        )
    own = copy.deepcopy(observer)

    @dataclass(frozen=True, kw_only=True)
    class OwnObserverConfig:
        """An observer that the calling program defines."""

        name: ClassVar[str] = called

        def build(self, dlo: BelievedDlo) -> ObserverStrategy:
            """The object, or the strategy with its settings."""
            return own.build(dlo) if hasattr(own, "build") else Adapted(copy.deepcopy(own))

    return OwnObserverConfig
