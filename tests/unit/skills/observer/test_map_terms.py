"""Each term's normal equations are those of its residual; the band is the matrix it stands for."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from dlokit.skills.observer.map_align import moved_rigidly
from dlokit.skills.observer.map_assign import assign, inlier_probability
from dlokit.skills.observer.map_solver import ChainSystem
from dlokit.skills.observer.map_terms import (
    ChainPriors,
    add_along,
    add_coherence,
    add_lengths,
    add_place,
    add_places,
    add_points,
    add_table,
)
from dlokit.skills.observer.map_tips import TipConfig, Tips, extent, places_along, seen_tips

Array = NDArray[np.float64]
M = 8
RNG = np.random.default_rng(5)
NODES = np.cumsum(RNG.normal([0.01, 0.0, 0.0], 0.004, (M, 3)), axis=0)
BEFORE = NODES + RNG.normal(0.0, 0.005, (M, 3))
REST = RNG.uniform(0.008, 0.012, M - 1)
POINTS = NODES[RNG.integers(0, M, 40)] + RNG.normal(0.0, 0.003, (40, 3))
FIRST = np.argmin(((POINTS[:, None] - 0.5 * (NODES[1:] + NODES[:-1])) ** 2).sum(axis=2), axis=1)
WEIGHTS = RNG.uniform(0.5, 2.0, 40)
DIRECTION = np.array([0.6, 0.0, 0.8])
PRIORS = ChainPriors()


def dense(system: ChainSystem) -> Array:
    """H as a full matrix, from its blocks."""
    H = np.zeros((3 * M, 3 * M))
    for offset, blocks in enumerate((system.diagonal, system.first, system.second)):
        for i, block in enumerate(blocks):
            a, b = 3 * (i + offset), 3 * i
            H[a : a + 3, b : b + 3] = block
            H[b : b + 3, a : a + 3] = block.T
    return H


def lengths(x: Array) -> float:
    return float(np.sum((np.linalg.norm(np.diff(x, axis=0), axis=1) - REST) ** 2)) / 0.01**2


def moved(x: Array) -> float:
    h, way, d = 0.01, 0.02, x - BEFORE
    return float(
        np.sum(np.diff(d, axis=0) ** 2) / (PRIORS.strain_per_m05**2 * h * way**2)
        + np.sum(np.diff(d, 2, axis=0) ** 2) / (PRIORS.bend_per_m15**2 * h**3 * way**2)
        + np.sum(np.diff(x, 2, axis=0) ** 2) / (PRIORS.straight_per_m05**2 * h**3)
        + np.sum(d**2) / (M * PRIORS.place_m**2)
    )


def across(x: Array) -> float:
    """Weighted squared distances of the points to the lines of their segments."""
    edge = np.diff(x, axis=0)[FIRST]
    off = POINTS - x[FIRST]
    t = np.sum(off * edge, axis=1) / np.sum(edge**2, axis=1)
    return float(WEIGHTS @ np.sum((off - t[:, None] * edge) ** 2, axis=1))


def points_term(system: ChainSystem) -> None:
    edge = np.diff(NODES, axis=0)[FIRST]
    t = np.sum((POINTS - NODES[FIRST]) * edge, axis=1) / np.sum(edge**2, axis=1)
    add_points(system, NODES, POINTS, FIRST, t, WEIGHTS)


TERMS: dict[str, tuple[Callable[[ChainSystem], None], Callable[[Array], float]]] = {
    "lengths": (lambda s: add_lengths(s, NODES, REST, 0.01), lengths),
    "coherence": (lambda s: add_coherence(s, BEFORE, 0.01, 0.02, PRIORS), moved),
    "points": (points_term, across),
    "places": (
        lambda s: add_places(s, WEIGHTS[:M], WEIGHTS[:M, None] * BEFORE),
        lambda x: float(WEIGHTS[:M] @ np.sum((x - BEFORE) ** 2, axis=1)),
    ),
    "pin": (lambda s: add_place(s, 3, BEFORE[3], 0.1), lambda x: float(np.sum((x[3] - BEFORE[3]) ** 2)) / 0.1**2),
    "along": (
        lambda s: add_along(s, 2, BEFORE[2], DIRECTION, 0.1),
        lambda x: float((DIRECTION @ (x[2] - BEFORE[2])) ** 2) / 0.1**2,
    ),
    "table": (
        lambda s: add_table(s, NODES, 0.003, 0.1),
        lambda x: float(np.sum(np.minimum(x[:, 2] - 0.003, 0.0) ** 2)) / 0.1**2,
    ),
}


@pytest.mark.parametrize("term", TERMS)
def test_hx_minus_b_is_half_the_gradient_of_the_squared_residuals(term: str) -> None:
    add, energy = TERMS[term]
    system = ChainSystem(M)
    add(system)
    gradient = dense(system) @ NODES.ravel() - system.rhs.ravel()
    step, numeric = 1e-6, np.zeros(3 * M)
    for k in range(3 * M):
        shift = np.zeros(3 * M)
        shift[k] = step
        high, low = energy(NODES + shift.reshape(M, 3)), energy(NODES - shift.reshape(M, 3))
        numeric[k] = 0.5 * (high - low) / (2 * step)
    # Central differences of 1 µm: relative error 1e-6 of the largest entry.
    np.testing.assert_allclose(gradient, numeric, atol=1e-5 * max(float(np.abs(numeric).max()), 1.0))


def full_system() -> ChainSystem:
    system = ChainSystem(M)
    for add, _ in TERMS.values():
        add(system)
    return system


def test_the_banded_solve_is_the_dense_solve() -> None:
    system = full_system()
    # The condition number is about 1e5: ten digits remain.
    np.testing.assert_allclose(
        system.solve().ravel(), np.linalg.solve(dense(system), system.rhs.ravel()), rtol=0, atol=1e-10
    )


def test_the_covariance_is_the_diagonal_blocks_of_the_dense_inverse() -> None:
    system = full_system()
    inverse = np.linalg.inv(dense(system)).reshape(M, 3, M, 3)
    expected = np.stack([inverse[i, :, i, :] for i in range(M)])
    np.testing.assert_allclose(system.covariance(), expected, rtol=0, atol=1e-8 * expected.max())


def test_a_straight_rod_that_moved_is_not_rolled() -> None:
    line = np.column_stack([np.linspace(0, 0.5, 9), np.zeros(9), np.zeros(9)])
    turn = np.radians(20)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    beside = line + np.array([0.0, 0.01, 0.02])  # would be carried elsewhere by a roll
    both = np.vstack([line, beside])
    weights = np.concatenate([np.ones(9), np.zeros(9)])
    after = line @ R.T + np.array([0.1, 0.0, 0.0])
    got = moved_rigidly(both, np.vstack([after, np.zeros((9, 3))]), weights)
    # kappa holds the turn back by 1 % of its sine at each end: 2 mm over 25 cm.
    np.testing.assert_allclose(got[9:], beside @ R.T + np.array([0.1, 0.0, 0.0]), atol=0.002)


def test_a_point_does_not_leave_its_window_however_near_the_other_strand_is() -> None:
    nodes = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 0.1, 0], [0, 0.1, 0]], dtype=np.float64)
    point = np.array([[0.5, 0.09, 0.0]])  # nearest to the last segment, known to be on the first
    zero = np.zeros(1, dtype=np.int64)
    placed = assign(point, nodes, zero, zero, 1)
    for _ in range(4):
        placed = assign(point, nodes, placed.segment, zero, 1)
    assert placed.segment[0] == 0
    free = assign(point, nodes, np.array([4]), zero, 5)
    assert free.segment[0] == 4


def test_inliers_weigh_one_and_outliers_nothing() -> None:
    weights = inlier_probability(np.array([0.0, 0.007**2, 0.02**2]), 0.002, 3.5)
    np.testing.assert_allclose(weights, [1.0, 0.5, 0.0], atol=0.003)  # exp(-3.5² / 2) = 0.002


def test_the_extent_of_a_cloud_is_found_despite_noise_and_its_gap_named() -> None:
    rng = np.random.default_rng(1)
    s = rng.uniform(0.02, 0.45, 1500)
    s = s[(s < 0.2) | (s > 0.3)] + rng.normal(0, 0.002, np.count_nonzero((s < 0.2) | (s > 0.3)))
    found = extent(np.append(s, 0.55), 0.5, TipConfig())  # one stray
    assert found is not None
    # Forty points in the last centimetre: the count's error is a sixth of it.
    assert found.start_m == pytest.approx(0.02, abs=0.003)
    assert found.end_m == pytest.approx(0.45, abs=0.003)
    assert found.gap_m == pytest.approx((0.2, 0.3), abs=0.007)  # bins of 5 mm


def test_a_tip_behind_something_known_is_no_tip() -> None:
    found = extent(np.random.default_rng(0).uniform(0.01, 0.4, 1500), 0.5, TipConfig())
    assert found is not None
    assert seen_tips(found, 0.5, False, False, TipConfig()).first_m == found.start_m
    assert seen_tips(found, 0.5, True, False, TipConfig()).first_m is None
    assert seen_tips(found, 0.5, False, False, TipConfig()).last_m is None  # 10 cm short


def test_what_does_not_fit_between_two_tips_is_taken_up_by_the_gap() -> None:
    rod = np.linspace(0.0, 0.5, 11)
    places = places_along(rod, Tips(first_m=0.01, last_m=0.53, gap_m=(0.2, 0.3)))
    np.testing.assert_allclose(places[:4], rod[:4] + 0.01, atol=1e-6)
    np.testing.assert_allclose(places[-4:], rod[-4:] + 0.03, atol=1e-6)
    np.testing.assert_allclose(places_along(rod, Tips(last_m=0.53)), rod + 0.03, atol=1e-12)
