"""The compiled E-step compared with its equation."""

import numpy as np
import pytest
from mixture_reference import expectation as written_out
from synthetic_clouds import cloud, shape

from dlokit.skills.observer.compiled import BLOCK, expectation, sorted_blocks
from dlokit.types.arrays import Float64Array

X_AXIS = np.array([1.0, 0.0, 0.0])


def points_of(rod: Float64Array, count: int = 1800) -> Float64Array:
    """About the middle of the table, as a fit has them."""
    return cloud(rod, count=count).points_world.astype(np.float64) - [0.5, 0.0, 0.0]


def nodes_of(name: str) -> Float64Array:
    return shape(name) - [0.5, 0.0, 0.0]


@pytest.mark.parametrize("outlier_weight", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("sigma_m", [0.1, 0.02, 0.005])
@pytest.mark.parametrize("nodes", ["I", "S"])
def test_the_sums_are_those_of_the_posteriors(outlier_weight: float, sigma_m: float, nodes: str) -> None:
    points, T = points_of(shape("S")), nodes_of(nodes)
    # Without outliers, a point 37 sigma from all nodes has the smallest numbers there are for probabilities.
    told = np.linalg.norm(points[:, None] - T[None], axis=2).min(axis=1) < 35.0 * sigma_m
    X = points if outlier_weight > 0.0 else points[told]
    P1, PX, squares = expectation(*sorted_blocks(X, X_AXIS), T, sigma_m**2, outlier_weight)
    expected_P1, expected_Pt1, expected_PX = written_out(X, T, sigma_m**2, outlier_weight)
    # Sums of a thousand terms in another order, of exponentials right to two units in the last place.
    np.testing.assert_allclose(P1, expected_P1, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(PX, expected_PX, rtol=1e-12, atol=1e-14)
    assert squares == pytest.approx(expected_Pt1 @ np.sum(X**2, axis=1), rel=1e-12)


def test_the_axis_that_points_are_sorted_by_changes_nothing() -> None:
    X, T = points_of(shape("U")), nodes_of("U")
    along, across = (expectation(*sorted_blocks(X, axis), T, 0.003**2, 0.05) for axis in (X_AXIS, X_AXIS[[1, 2, 0]]))
    for one, other in zip(along, across, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)  # another order of sums


def test_nodes_too_far_from_a_block_are_omitted() -> None:
    X = np.full((10, 3), 0.001)
    near, far = (np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0]]) for x in (0.1, 0.12))
    left_in = expectation(*sorted_blocks(X, X_AXIS), near, 0.01**2, 0.05)[0]
    left_out = expectation(*sorted_blocks(X, X_AXIS), far, 0.01**2, 0.05)[0]
    assert 0.0 < left_in[1] < 1e-20  # ten sigma away
    assert left_out[1] == 0.0  # twelve sigma: 1e-30, which changes no sum
    assert written_out(X, far, 0.01**2, 0.05)[0][1] > 0.0


def test_points_out_of_reach_belong_to_the_outliers() -> None:
    T = nodes_of("S")
    P1, PX, squares = expectation(*sorted_blocks(np.full((70, 3), 5.0), X_AXIS), T, 0.01**2, 0.05)
    assert not P1.any()
    assert not PX.any()
    assert squares == 0.0


@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK, BLOCK + 1])
def test_blocks_may_be_of_any_length(count: int) -> None:
    X, T = points_of(shape("S"))[:count], nodes_of("S")
    P1, _, _ = expectation(*sorted_blocks(X, X_AXIS), T, 0.01**2, 0.05)
    np.testing.assert_allclose(P1, written_out(X, T, 0.01**2, 0.05)[0], rtol=1e-12, atol=1e-14)


def test_boxes_hold_the_points_of_their_block() -> None:
    X = points_of(shape("U"))
    columns, boxes = sorted_blocks(X, X_AXIS)
    np.testing.assert_array_equal(np.sort(X[:, 0]), columns[0])
    assert len(boxes) == -(-len(X) // BLOCK)
    for block, (low, high) in enumerate(boxes):
        inside = columns[:, block * BLOCK : (block + 1) * BLOCK]
        np.testing.assert_array_equal(low, inside.min(axis=1))
        np.testing.assert_array_equal(high, inside.max(axis=1))
