"""Locally linear weights against their definition."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_clouds import shape

from dlokit.skills.observer.spr import lle_weights, structure_matrix

HELIX_T = np.linspace(0.0, 4.0, 25)
HELIX = np.column_stack([0.1 * np.cos(HELIX_T), 0.1 * np.sin(HELIX_T), 0.05 * HELIX_T])


@pytest.mark.parametrize("neighbours", [2, 4, 6, 10])
def test_weights_sum_to_one_over_the_nearest_nodes_only(neighbours: int) -> None:
    W = lle_weights(HELIX, neighbours, 1e-3)
    np.testing.assert_allclose(W.sum(axis=1), 1.0, atol=1e-12)  # rounding of a division
    np.testing.assert_array_equal(np.diag(W), 0.0)
    distance = np.linalg.norm(HELIX[:, None] - HELIX[None], axis=2)
    nearest = np.argsort(distance, axis=1)[:, 1 : neighbours + 1]
    for i, near in enumerate(nearest):
        assert set(np.flatnonzero(W[i])) == set(near)


def test_weights_put_each_node_together_from_its_neighbours() -> None:
    W = lle_weights(HELIX, 6, 1e-10)
    # Six neighbours on a helix span space: only the regularisation causes an error, here 0.1 um.
    np.testing.assert_allclose(W @ HELIX, HELIX, atol=1e-6)


def test_the_regularisation_changes_little() -> None:
    W = lle_weights(HELIX, 6, 1e-3)
    spacing = np.linalg.norm(HELIX[1] - HELIX[0])
    # It prefers even weights: a node at a tip, outside its neighbours, has the largest residual.
    assert np.max(np.linalg.norm(W @ HELIX - HELIX, axis=1)) < 0.3 * spacing


def test_no_other_weights_that_sum_to_one_have_lower_cost() -> None:
    K, regularisation = 5, 1e-3
    W = lle_weights(HELIX, K, regularisation)
    rng = np.random.default_rng(0)
    for i in range(len(HELIX)):
        near = np.flatnonzero(W[i])
        Z = HELIX[near] - HELIX[i]
        weight = regularisation * np.sum(Z**2)  # the trace of the Gram matrix
        best = np.sum((W[i, near] @ Z) ** 2) + weight * np.sum(W[i, near] ** 2)
        for _ in range(20):
            step = rng.normal(size=K)
            other = W[i, near] + 0.1 * (step - step.mean())  # still sums to one
            assert np.sum((other @ Z) ** 2) + weight * np.sum(other**2) > best


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_weights_do_not_change_when_the_shape_is_turned_scaled_and_shifted(scale: float) -> None:
    R = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
    moved = scale * HELIX @ R.T + np.array([0.4, -0.2, 0.7])
    # Rounding of coordinates of 1 m for a shape of 0.1 mm leaves eight digits.
    np.testing.assert_allclose(lle_weights(moved, 6, 1e-3), lle_weights(HELIX, 6, 1e-3), atol=1e-6)


def test_the_structure_matrix_measures_the_reconstruction_error() -> None:
    W = lle_weights(HELIX, 6, 1e-3)
    T = np.random.default_rng(0).normal(size=HELIX.shape)
    M = structure_matrix(W)
    assert np.trace(T.T @ M @ T) == pytest.approx(np.sum((T - W @ T) ** 2), rel=1e-12)  # rounding
    np.testing.assert_allclose(M @ np.ones(len(M)), 0.0, atol=1e-12)  # a shift changes nothing


@pytest.mark.parametrize("count", [2, 3, 5])
def test_fewer_nodes_than_neighbours_and_nodes_on_a_line_are_accepted(count: int) -> None:
    W = lle_weights(shape("I")[:count], 6, 1e-3)
    np.testing.assert_allclose(W.sum(axis=1), 1.0, atol=1e-12)


def test_nodes_in_one_place_get_equal_weights() -> None:
    W = lle_weights(np.zeros((8, 3)), 4, 1e-3)
    assert np.isfinite(W).all()
    np.testing.assert_allclose(W[W > 0], 0.25)
