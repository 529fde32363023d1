"""The protocol of observer strategies: they estimate target points from a cloud and the previous state (Fig. 3)."""

from typing import ClassVar, Protocol

import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation


class ObserverStrategy(Protocol):
    """A method that estimates the nodes of a DLO from a cloud and the previous nodes."""

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The nodes (M, 3) [m] in the world, in the order of `prior`, with the stamp of `seen`.

        Pure: the same arguments give the same result. Hidden nodes are marked not visible and stay coherent with their
        neighbours. For an empty cloud the result is the prior, with no node visible and health 0.
        """
        ...


class ObserverStrategyConfig(Protocol):
    """Settings and factory of a strategy: a frozen dataclass whose fields all have defaults.

    Every process imports this class with its module. The module must not import a large library: compiled functions
    are in another module, which the calling function imports, and `import scipy` loads its parts at their first use.
    """

    name: ClassVar[str]

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """Build the strategy with these settings for the configured DLO."""
        ...


def nothing_seen(seen: Observation, prior: DloState) -> TargetPoints:
    """The prior's nodes, none visible: the result of every strategy for an empty cloud."""
    return TargetPoints(
        stamp_ns=seen.stamp_ns,
        nodes_world=prior.nodes_world.copy(),
        visible=np.zeros(len(prior.nodes_world), dtype=np.bool_),
        health=0.0,
    )


def prior_from(targets: TargetPoints, topology: Topology) -> DloState:
    """The targets as the prior for the next cloud, if no model tracks them."""
    return DloState(
        stamp_ns=targets.stamp_ns,
        nodes_world=targets.nodes_world,
        topology=topology,
        visible=targets.visible,
        observed_stamp_ns=targets.stamp_ns,
        health=targets.health,
        covariance=targets.covariance,
    )
