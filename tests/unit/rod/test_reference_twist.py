"""The reference twist of the planning rod: against directors that are transported with the edges."""

import itertools

import numpy as np
import pytest

from dlokit.rod.believed import BelievedDlo
from dlokit.rod.planning_rod import carry_twist
from dlokit.rod.rollout import PlanningRod
from dlokit.types.arrays import Float64Array

MODEL = BelievedDlo()
NODES = 21
STEPS = 2000
EDGE_M = MODEL.length_m / (NODES - 1)


def coil(share: float) -> Float64Array:
    """A rod (M, 3) [m] on its way from an arc in the plane, at 0, to a helix, at 1, with its first edge tilting."""
    heading = 0.25 * np.arange(NODES - 1)
    climb = 0.6 * share * np.sin(0.2 * np.arange(NODES - 1) + 1.3 * share)
    edges = np.column_stack((np.cos(heading) * np.cos(climb), np.sin(heading) * np.cos(climb), np.sin(climb)))
    return np.vstack((np.zeros(3), np.cumsum(EDGE_M * edges, axis=0)))


def transported(director: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
    """A director (3,) turned by the smallest rotation from one edge (3,) to another (Rodrigues)."""
    a, b = before / np.linalg.norm(before), after / np.linalg.norm(after)
    axis = np.cross(a, b)
    turned: Float64Array = a @ b * director + np.cross(axis, director) + axis * (axis @ director) / (1.0 + a @ b)
    return turned


@pytest.mark.heavy
def test_a_rod_that_coils_without_turning_about_its_axis_is_twisted_as_its_directors_say() -> None:
    rod = PlanningRod().numbers(MODEL, NODES)
    shapes = [coil(share) for share in np.linspace(0.0, 1.0, STEPS + 1)]
    x = np.zeros((NODES, 5))
    for before, after in itertools.pairwise(shapes):
        x[:, :3] = 0.5 * (before + after)
        carry_twist(x, np.column_stack((after - before, np.zeros(NODES))), rod, 1.0)

    directors = [np.array([0.0, 0.0, 1.0])] * (NODES - 1)  # across every edge of the arc in the plane
    for before, after in itertools.pairwise(shapes):
        edges = zip(directors, np.diff(before, axis=0), np.diff(after, axis=0), strict=True)
        directors = [transported(*edge) for edge in edges]
    tangents = np.diff(shapes[-1], axis=0) / EDGE_M
    twists = list[float]()
    for i in range(1, NODES - 1):
        across = transported(directors[i - 1], tangents[i - 1], tangents[i])
        twists.append(float(np.arctan2(np.cross(across, directors[i]) @ tangents[i], across @ directors[i])))
    assert max(twists) > 0.1  # the coil does twist
    # 2,000 steps: what they leave out falls with the square of a step.
    assert x[:, 4].sum() / MODEL.radius_m == pytest.approx(sum(twists), rel=1e-3)
    halves = 0.5 * (np.array([0.0, *twists]) + np.array([*twists, 0.0]))
    assert x[:-1, 4] / MODEL.radius_m == pytest.approx(halves, abs=1e-4)
