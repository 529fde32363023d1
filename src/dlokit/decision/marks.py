"""Pairs of grasp and shape that led to nothing (Fig. 6, and McConachie et al., who forbid the pair)."""

from collections.abc import Sequence
from dataclasses import dataclass

from dlokit.geometry import rmse_m
from dlokit.types.arrays import Float64Array


@dataclass(frozen=True, kw_only=True)
class FailedPair:
    """A grasp that led to nothing from a shape."""

    node: int
    nodes_world: Float64Array  # (M, 3) [m]


def still_marked(pairs: Sequence[FailedPair], nodes_world: Float64Array, alike_m: float) -> list[FailedPair]:
    """The pairs whose shape is nearer than `alike_m` (RMSE) [m] to the present one (M, 3) [m]; with 0 none is."""
    return [pair for pair in pairs if rmse_m(pair.nodes_world, nodes_world) < alike_m]
