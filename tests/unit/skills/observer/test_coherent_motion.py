"""The M-step with few unknowns compared with the full equation."""

import numpy as np
import pytest
from synthetic_clouds import shape

from dlokit.skills.observer.mixture import CoherentMotion, kernel, low_rank
from dlokit.skills.observer.spr import lle_weights, structure_matrix
from dlokit.types.arrays import Float64Array


def moments(Y: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Some points for each node but three, about a centimetre from it."""
    rng = np.random.default_rng(0)
    P1 = rng.uniform(10.0, 60.0, len(Y))
    P1[4:7] = 0.0
    return P1, P1[:, None] * (Y + np.array([0.01, 0.0, 0.002]) + rng.normal(0.0, 0.001, Y.shape))


@pytest.mark.parametrize("beta_m", [0.02, 0.12, 0.8])
def test_the_kernel_is_its_factor_times_itself_in_few_columns(beta_m: float) -> None:
    G = kernel(shape("S"), beta_m)
    L = low_rank(G)
    np.testing.assert_allclose(L @ L.T, G, atol=1e-14)  # rounding of sums of up to 31 products below one
    assert L.shape[1] <= {0.02: 31, 0.12: 31, 0.8: 20}[beta_m]  # the wider the kernel, the more similar the columns


@pytest.mark.parametrize("stiffness", [0.0, 1e2])
@pytest.mark.parametrize("ridge", [1.0, 1e-3])
def test_nodes_and_coefficients_solve_the_papers_equation(stiffness: float, ridge: float) -> None:
    Y = shape("S") - shape("S").mean(axis=0)
    G, (P1, PX) = kernel(Y, 0.12), moments(Y)
    M = structure_matrix(lle_weights(Y, 10, 1e-3))
    motions = CoherentMotion(Y, G, M)
    T = motions.nodes(P1, PX, ridge, stiffness)
    W = motions.coefficients(P1, PX, T, ridge, stiffness)
    left = (np.diag(P1) @ G + ridge * np.eye(len(Y)) + stiffness * M @ G) @ W
    right = PX - np.diag(P1) @ Y - stiffness * M @ Y
    # Terms of up to 10 m, some divided by the ridge and multiplied by it again.
    np.testing.assert_allclose(left, right, atol=1e-9)
    np.testing.assert_allclose(Y + G @ W, T, atol=1e-10)


def test_without_local_structure_it_is_coherent_point_drift() -> None:
    Y = shape("S") - shape("S").mean(axis=0)
    G, (P1, PX) = kernel(Y, 0.12), moments(Y)
    W = np.linalg.solve(P1[:, None] * G + 0.01 * np.eye(len(Y)), PX - P1[:, None] * Y)
    # Gauss's method on an unsymmetric system loses some digits: its condition is 1e5.
    np.testing.assert_allclose(CoherentMotion(Y, G).nodes(P1, PX, 0.01), Y + G @ W, atol=1e-10)


def test_nodes_without_any_points_stay() -> None:
    Y = shape("S")
    nodes = CoherentMotion(Y, kernel(Y, 0.12)).nodes(np.zeros(len(Y)), np.zeros_like(Y), 0.01)
    np.testing.assert_array_equal(nodes, Y)


def test_a_smoothness_of_zero_is_refused_by_name() -> None:
    Y = shape("S")
    with pytest.raises(np.linalg.LinAlgError, match="must be above 0"):
        CoherentMotion(Y, kernel(Y, 0.12)).nodes(np.zeros(len(Y)), np.zeros_like(Y), 0.0)
