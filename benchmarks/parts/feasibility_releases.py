"""What the cell does with its DLO laid in a goal, and in shapes near it, and released: the judge of verdicts."""

import enum
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description import shapes
from dlokit.evaluation.evaluator import SETTLE_S
from dlokit.functional.cell.world import Cell
from dlokit.rod.equilibrium import nearest_static
from dlokit.skills.planning.verdict.feasibility import overlaps
from dlokit.types.arrays import Float64Array
from parts.feasibility_beliefs import true_elastic_m3

_FRICTION_SHARES = (1.2, 0.9, 0.7)  # with which the nearest shape that holds is sought
_CORRECTIONS = 3  # times that a shape is bent further by what it sprang back


class Happened(enum.Enum):
    """What the cell's DLO did."""

    STAYED = "stayed"
    """Laid in the goal it stayed within the threshold."""
    REACHED = "reached"
    """It did not, but laid in another shape it came to rest within the threshold."""
    MISSED = "missed"
    """Of all the shapes that it was laid in, none led there."""


@dataclass(frozen=True, kw_only=True)
class ReleasedGoal:
    """What happened to a goal."""

    happened: Happened
    true_rmse_m: float
    """How far the DLO sprang back from the goal [m]."""
    best_rmse_m: float
    """How near to it it came to rest at best [m]."""


def release(cell: Cell, curve_world: Float64Array, nodes: int, threshold_m: float) -> ReleasedGoal:
    """Lay the cell's DLO along a goal (K, 3) [m] and let go; where it does not stay, try shapes near the goal.

    These are the nearest ones that friction holds, by the true figures of the DLO, and ones that are bent further by
    as much as the DLO sprang back. Errors are RMSEs over so many `nodes`.
    """
    goal = geometry.resample(curve_world, nodes)
    rested = _rest(cell, curve_world, nodes)
    true_m = best_m = geometry.rmse_m(rested, goal)
    if true_m > threshold_m:
        for tried in _attempts(cell, goal, rested):
            best_m = min(best_m, geometry.rmse_m(tried, goal))
            if best_m <= threshold_m:
                break
    happened = Happened.MISSED if best_m > threshold_m else Happened.REACHED
    return ReleasedGoal(
        happened=Happened.STAYED if true_m <= threshold_m else happened, true_rmse_m=true_m, best_rmse_m=best_m
    )


def _attempts(cell: Cell, goal: Float64Array, rested: Float64Array) -> Iterator[Float64Array]:
    """Where the DLO comes to rest (M, 3) [m], laid in one shape after the other."""
    radius_m = cell.config.dlo.radius_m
    laid = goal
    for _ in range(_CORRECTIONS):
        laid = _bent_further(laid, rested, goal)
        if overlaps(laid, radius_m):
            break
        rested = _rest(cell, laid, len(goal))
        yield rested
    if cell.config.dlo.yield_curvature_1_m is not None:
        return
    for share in _FRICTION_SHARES:
        held = nearest_static(goal, true_elastic_m3(cell) / share).nodes_world
        if not overlaps(held, radius_m):
            yield _rest(cell, held, len(goal))


def _rest(cell: Cell, laid_world: Float64Array, nodes: int) -> Float64Array:
    cell.place_dlo(shapes.fit_length(laid_world, cell.config.dlo.length_m), settle=False)
    cell.step(SETTLE_S)
    return geometry.resample(cell.true_nodes_world(), nodes)


def _bent_further(laid: Float64Array, rested: Float64Array, goal: Float64Array) -> Float64Array:
    """A shape (M, 3) [m] with headings turned by as much as those it came to rest with are off those of the goal."""
    headings = _headings(laid) + _headings(goal) - _headings(rested)
    edge_m = float(geometry.arc_lengths(goal)[-1]) / len(headings)
    edges = edge_m * np.column_stack((np.cos(headings), np.sin(headings)))
    nodes = np.vstack((np.zeros(2), np.cumsum(edges, axis=0)))
    result = goal.copy()
    result[:, :2] = nodes - nodes.mean(axis=0) + goal[:, :2].mean(axis=0)
    return result


def _headings(nodes: Float64Array) -> Float64Array:
    edges = np.diff(nodes[:, :2], axis=0)
    return np.unwrap(np.arctan2(edges[:, 1], edges[:, 0]))
