"""The protocol of observer strategies: they estimate target points from a cloud and the previous state (Fig. 3)."""

from typing import ClassVar, Protocol, cast

import msgspec
import numpy as np

from dlokit.communication.wire.codec import LARGEST_RANK
from dlokit.rod.believed import BelievedDlo
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation


class ObserverStrategy(Protocol):
    """A method that estimates the nodes of a DLO from a cloud and the previous nodes."""

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The nodes (M, 3) [m] in the world, in the order of `prior`, with the stamp of `seen`.

        Pure: the same arguments give the same result. Hidden nodes are marked not visible and stay coherent with their
        neighbours. For an empty cloud the result is the prior, with no node visible and health 0.

        A filter that needs more than the prior's nodes returns it as `memory` of the targets, and finds it as
        `prior.memory` at the next cloud that is used. It is empty at the beginning, after the rod was lost, and after a
        call that failed.
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


MOST_MEMORY_BYTES = 256 * 1024
"""Largest sum of the arrays of a memory [bytes]: it is in each message of the targets and of the model's state, and in
the recording. 200 particles of 51 nodes fit."""


def memory_flaw(memory: object) -> str | None:
    """What is wrong with the memory of an observer's targets, in a sentence; None if nothing is."""
    if not isinstance(memory, dict):
        return f"memory is a {type(memory).__name__}; it must be a dict of names and float64 arrays"
    size = 0
    for name, array in cast("dict[object, object]", memory).items():
        if not isinstance(name, str):
            return f"memory has the name {name!r}; names must be texts"
        if not isinstance(array, np.ndarray) or array.dtype != np.float64 or array.ndim > LARGEST_RANK:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            return (
                f"memory {name!r} is {found}; it must be a float64 array of at most {LARGEST_RANK} dimensions: "
                "convert it with np.asarray(value, dtype=np.float64)"
            )
        size += array.nbytes
    if size > MOST_MEMORY_BYTES:
        return (
            f"memory has {size} bytes; at most {MOST_MEMORY_BYTES} ({MOST_MEMORY_BYTES // 1024} KiB) are allowed: keep "
            "fewer particles, or less of each"
        )
    return None


def nothing_seen(seen: Observation, prior: DloState) -> TargetPoints:
    """The prior's nodes, none visible, and its memory: the result of every strategy for an empty cloud."""
    return TargetPoints(
        stamp_ns=seen.stamp_ns,
        nodes_world=prior.nodes_world.copy(),
        visible=np.zeros(len(prior.nodes_world), dtype=np.bool_),
        health=0.0,
        memory=prior.memory,
    )


def without_memory(targets: TargetPoints) -> TargetPoints:
    """The targets after which the observer begins again, because it failed: what it remembers may be why."""
    return msgspec.structs.replace(targets, memory={}) if targets.memory else targets


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
        memory=targets.memory,
    )
