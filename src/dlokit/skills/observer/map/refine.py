"""A chain of few nodes, refined: between far nodes a rod bends, and points would lie beside straight segments.

The problem is solved with nodes in between, on a cubic spline through the given ones, which alone are returned.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dlokit.types.dlo import DloState, Topology
from dlokit.types.observation import GripperPin

Array = NDArray[np.float64]


def refinement(prior: DloState, longest_edge_m: float) -> int:
    """Into how many pieces each edge is to be cut so that none is longer than `longest_edge_m`."""
    return max(int(np.ceil(float(np.mean(prior.topology.rest_lengths_m)) / longest_edge_m)), 1)


def refined(prior: DloState, pieces: int) -> DloState:
    """The prior with each edge of its chain cut into `pieces` of equal rest length."""
    if pieces == 1:
        return prior
    rest = np.repeat(prior.topology.rest_lengths_m / pieces, pieces)
    at = np.concatenate(([0.0], np.cumsum(rest)))
    first = np.arange(len(rest))
    spline = CubicSpline(at[::pieces], prior.nodes_world)
    nearest = np.rint(np.arange(len(at)) / pieces).astype(np.int64)
    return DloState(
        stamp_ns=prior.stamp_ns,
        nodes_world=np.asarray(spline(at), dtype=np.float64),
        topology=Topology(edges=np.column_stack([first, first + 1]).astype(np.int64), rest_lengths_m=rest),
        visible=None if prior.visible is None else prior.visible[nearest],
        observed_stamp_ns=prior.observed_stamp_ns,
        health=prior.health,
        covariance=None if prior.covariance is None else prior.covariance[nearest],
    )


def refined_pins(pins: tuple[GripperPin, ...], pieces: int) -> tuple[GripperPin, ...]:
    """The pins, at the same nodes of the refined chain."""
    return tuple(GripperPin(robot=pin.robot, node=pin.node * pieces, position_world=pin.position_world) for pin in pins)
