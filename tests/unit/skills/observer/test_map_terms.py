"""Each term's normal equations are those of its residual, and the band equals the full matrix."""

from collections.abc import Callable

import numpy as np
import pytest

from dlokit.skills.observer.map import terms
from dlokit.skills.observer.map.assign import assign, inlier_probability, moments, soft_places
from dlokit.skills.observer.map.problem import PLACE_SIGMA_M
from dlokit.skills.observer.map.stages import moved_rigidly
from dlokit.skills.observer.map.terms import (
    BELOW,
    ChainSystem,
    add_coherence,
    add_lengths,
    add_place,
    add_places,
    add_points,
    add_table,
    add_tip,
    coherence,
)
from dlokit.skills.observer.map.tips import Tips, extent, places_along, seen_tips
from dlokit.types.arrays import Float64Array

M = 8
RNG = np.random.default_rng(5)
NODES = np.cumsum(RNG.normal([0.01, 0.0, 0.0], 0.004, (M, 3)), axis=0)
BEFORE = NODES + RNG.normal(0.0, 0.005, (M, 3))
REST = RNG.uniform(0.008, 0.012, M - 1)
POINTS = NODES[RNG.integers(0, M, 40)] + RNG.normal(0.0, 0.003, (40, 3))
FIRST = np.argmin(((POINTS[:, None] - 0.5 * (NODES[1:] + NODES[:-1])) ** 2).sum(axis=2), axis=1)
WEIGHTS = RNG.uniform(0.5, 2.0, 40)


def dense(system: ChainSystem) -> Float64Array:
    """H as a full matrix, from its band."""
    H = np.zeros((3 * M, 3 * M))
    for r in range(3 * M):
        for c in range(max(0, r - BELOW), r + 1):
            H[r, c] = H[c, r] = system.band[c, r - c]
    return H


def lengths(x: Float64Array) -> float:
    return float(np.sum((np.linalg.norm(np.diff(x, axis=0), axis=1) - REST) ** 2)) / 0.01**2


def moved(x: Float64Array) -> float:
    h, moved, d = 0.01, 0.02, x - BEFORE
    return float(
        np.sum(np.diff(d, axis=0) ** 2) / (terms.STRAIN_PER_M05**2 * h * moved**2)
        + np.sum(np.diff(d, 2, axis=0) ** 2) / (terms.BEND_PER_M15**2 * h**3 * moved**2)
        + np.sum(np.diff(x, 2, axis=0) ** 2) / (terms.STRAIGHT_PER_M05**2 * h**3)
        + np.sum(d**2) / (M * PLACE_SIGMA_M**2)
    )


def across(x: Float64Array) -> float:
    """Weighted squared distances of the points to the lines of their segments."""
    edge = np.diff(x, axis=0)[FIRST]
    off = POINTS - x[FIRST]
    t = np.sum(off * edge, axis=1) / np.sum(edge**2, axis=1)
    return float(WEIGHTS @ np.sum((off - t[:, None] * edge) ** 2, axis=1))


def points_term(system: ChainSystem) -> None:
    edge = np.diff(NODES, axis=0)[FIRST]
    t = np.sum((POINTS - NODES[FIRST]) * edge, axis=1) / np.sum(edge**2, axis=1)
    columns = [WEIGHTS, WEIGHTS * t, WEIGHTS * t**2, *(WEIGHTS * POINTS.T), *(WEIGHTS * t * POINTS.T)]
    sums = np.column_stack([np.bincount(FIRST, column, M - 1) for column in columns]).astype(np.float64)
    add_points(system.band, system.rhs, NODES, sums)


def coherence_term(system: ChainSystem) -> None:
    K_d, K_x = coherence(M, 0.01)
    K = K_d / 0.02**2
    K[:, 0] += 1.0 / (M * PLACE_SIGMA_M**2)
    add_coherence(system.band, system.rhs, BEFORE, K, K_x)


def along_the_end(x: Float64Array) -> float:
    """Displacement of the last node along the direction of the last two edges; it should stay."""
    along = NODES[-1] - NODES[-3]
    return float((along / np.linalg.norm(along)) @ (x[-1] - NODES[-1])) ** 2 / 0.1**2


TERMS: dict[str, tuple[Callable[[ChainSystem], None], Callable[[Float64Array], float]]] = {
    "lengths": (lambda s: add_lengths(s.band, s.rhs, NODES, REST, 0.01), lengths),
    "coherence": (coherence_term, moved),
    "points": (points_term, across),
    "places": (
        lambda s: add_places(s.band, s.rhs, WEIGHTS[:M], WEIGHTS[:M, None] * BEFORE, 2.0),
        lambda x: float(2.0 * WEIGHTS[:M] @ np.sum((x - BEFORE) ** 2, axis=1)),
    ),
    "pin": (
        lambda s: add_place(s.band, s.rhs, 3, BEFORE[3], 0.1),
        lambda x: float(np.sum((x[3] - BEFORE[3]) ** 2)) / 0.1**2,
    ),
    "tip": (lambda s: add_tip(s.band, s.rhs, NODES, M - 1, M - 3, 0.1), along_the_end),
    "table": (
        lambda s: add_table(s.band, s.rhs, NODES, 0.003, 0.1),
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
    beside = line + np.array([0.0, 0.01, 0.02])  # a roll would move it
    both = np.vstack([line, beside])
    weights = np.concatenate([np.ones(9), np.zeros(9)])
    after = line @ R.T + np.array([0.1, 0.0, 0.0])
    got = moved_rigidly(both, np.vstack([after, np.zeros((9, 3))]), weights)
    # kappa reduces the turn by 1 % of its sine at each end: 2 mm over 25 cm.
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


def test_inliers_have_weight_one_and_outliers_zero() -> None:
    weights = [inlier_probability(d**2, 0.002, 3.5) for d in (0.0, 0.007, 0.02)]
    np.testing.assert_allclose(weights, [1.0, 0.5, 0.0], atol=0.003)  # exp(-3.5² / 2) = 0.002


def test_the_soft_assignment_is_that_of_a_gaussian_mixture_with_outliers() -> None:
    weights, sums = soft_places(POINTS, NODES, 0.01, 0.1)
    likely = np.exp(-np.sum((POINTS[:, None] - NODES[None]) ** 2, axis=2) / (2 * 0.01**2))
    p = likely / (likely.sum(axis=1, keepdims=True) + 0.1)
    # The approximation of the Gaussian changes a node's weight by at most 0.02 of a point's total of 1.
    np.testing.assert_allclose(weights, p.sum(axis=0), atol=0.02 * len(POINTS))
    np.testing.assert_allclose(sums / weights[:, None], (p.T @ POINTS) / p.sum(axis=0)[:, None], atol=0.001)


def test_a_segment_with_many_points_counts_as_one_with_the_most_allowed() -> None:
    nodes = np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]])
    points = np.column_stack([np.linspace(0.0, 0.01, 100), np.zeros(100), np.zeros(100)])
    zero = np.zeros(100, dtype=np.int64)
    placed = assign(points, nodes, zero, zero, 1)
    sums = moments(points, placed.segment, placed.t, placed.distance2, 2, 0.002, 3.5, 20.0)
    assert sums[0, 0] * 0.002**2 == pytest.approx(20.0)
    assert sums[0, 3] / sums[0, 0] == pytest.approx(0.005)  # the mean of the points stays


def test_the_extent_and_the_gap_of_a_cloud_are_found_despite_noise() -> None:
    rng = np.random.default_rng(1)
    s = rng.uniform(0.02, 0.45, 1500)
    s = s[(s < 0.2) | (s > 0.3)] + rng.normal(0, 0.002, np.count_nonzero((s < 0.2) | (s > 0.3)))
    found = extent(np.append(s, 0.55), 0.5)  # one stray
    assert found is not None
    # Forty points in the last centimetre: the count's error is a sixth of it.
    assert found.start_m == pytest.approx(0.02, abs=0.003)
    assert found.end_m == pytest.approx(0.45, abs=0.003)
    assert found.gap_m == pytest.approx((0.2, 0.3), abs=0.007)  # bins of 5 mm


def test_a_tip_behind_a_known_occlusion_does_not_count() -> None:
    found = extent(np.random.default_rng(0).uniform(0.01, 0.4, 1500), 0.5)
    assert found is not None
    assert seen_tips(found, 0.5, False, False, 0.03).first_m == found.start_m
    assert seen_tips(found, 0.5, True, False, 0.03).first_m is None
    assert seen_tips(found, 0.5, False, False, 0.03).last_m is None  # 10 cm short


def test_the_length_across_a_gap_does_not_make_a_hidden_end_a_tip() -> None:
    s = np.random.default_rng(0).uniform(0.0, 0.49, 1500)
    found = extent(s[(s < 0.2) | (s > 0.3)], 0.5)
    assert found is not None
    assert seen_tips(found, 0.5, False, True, 0.12).last_m is None
    assert seen_tips(found, 0.5, False, False, 0.12).last_m == found.end_m


def test_excess_length_between_two_tips_goes_into_the_gap() -> None:
    rod = np.linspace(0.0, 0.5, 11)
    places = places_along(rod, Tips(first_m=0.01, last_m=0.53, gap_m=(0.2, 0.3)))
    np.testing.assert_allclose(places[:4], rod[:4] + 0.01, atol=1e-6)
    np.testing.assert_allclose(places[-4:], rod[-4:] + 0.03, atol=1e-6)
    np.testing.assert_allclose(places_along(rod, Tips(last_m=0.53)), rod + 0.03, atol=1e-12)


def test_rounding_does_not_decide_whether_a_node_at_rest_is_below_the_table() -> None:
    for z in (0.004, np.nextafter(0.004, 0.0), np.nextafter(0.004, 1.0)):
        nodes, system = np.column_stack([NODES[:, :2], np.full(M, z)]), ChainSystem(M)
        add_table(system.band, system.rhs, nodes, 0.004, 0.1)
        assert not system.band.any()


def test_rounding_does_not_decide_on_which_side_of_a_bend_a_point_outside_of_it_is() -> None:
    nodes = np.array([[0, 0, 0], [1, 0.1, 0], [2, 0.3, 0], [3, 0, 0]], dtype=np.float64)
    # Points fanned out outside the bend at node 2, which is the nearest node of all.
    turns = np.linspace(np.radians(87), np.radians(98), 50)
    points = nodes[2] + 0.02 * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(50)])
    for start in (1, 2):
        around = np.full(50, start, dtype=np.int64)
        assert (assign(points, nodes, around, around, 3).segment == start).all()
