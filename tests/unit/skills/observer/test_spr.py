"""Structure preserved registration compared with its equations and with CPD."""

from dataclasses import replace

import numpy as np
from mixture_reference import expectation
from numpy.typing import NDArray
from synthetic_clouds import cloud, shape, state

from dlokit.geometry import rmse_m
from dlokit.skills.observer import cpd
from dlokit.skills.observer.cpd import Cpd, CpdConfig
from dlokit.skills.observer.mixture import kernel
from dlokit.skills.observer.spr import Spr, SprConfig, lle_weights, register, structure_matrix

# With this narrow kernel, coherent motion alone preserves little of the shape; wide defaults preserve more.
PLIABLE_CPD = CpdConfig(beta_m=0.12, lambda_per_m2=300.0, outlier_weight=0.05, initial_sigma_m=0.04)
PLIABLE = SprConfig(
    beta_m=0.12,
    lambda_per_m2=300.0,
    outlier_weight=0.05,
    initial_sigma_m=0.04,
    tau_per_m2=1e7,
    neighbours=10,
    tau_annealing=0.9,
    lambda_annealing=0.97,
)


def points_of(rod: NDArray[np.float64], seed: int = 0) -> NDArray[np.float64]:
    return cloud(rod, seed).points_world[:500].astype(np.float64)


def test_without_local_structure_and_annealing_it_is_cpd() -> None:
    X, Y = points_of(shape("S")), shape("S") + np.array([0.02, 0.01, 0.0])
    ours = register(X, Y, replace(PLIABLE, tau_per_m2=0.0, tau_annealing=1.0, lambda_annealing=1.0))
    theirs = cpd.register(X, Y, PLIABLE_CPD)
    np.testing.assert_array_equal(ours.nodes, theirs.nodes)
    np.testing.assert_array_equal(ours.sigma2, theirs.sigma2)


def test_one_iteration_solves_the_papers_equation() -> None:
    X, Y = points_of(shape("S")), shape("S") + np.array([0.02, 0.01, 0.0])
    config = replace(PLIABLE, max_iterations=1, tau_per_m2=1e6)
    W = register(X, Y, config).coefficients
    sigma2, G = config.initial_sigma_m**2, kernel(Y, config.beta_m)
    M = structure_matrix(lle_weights(Y, config.neighbours, config.regularisation))
    P1, _, PX = expectation(X, Y, sigma2, config.outlier_weight)
    left = (np.diag(P1) @ G + config.lambda_per_m2 * sigma2 * np.eye(len(Y)) + config.tau_per_m2 * sigma2 * M @ G) @ W
    right = PX - np.diag(P1) @ Y - config.tau_per_m2 * sigma2 * M @ Y
    # PX is up to 30 m in sum; the rest is rounding, magnified by the distances to the origin.
    np.testing.assert_allclose(left, right, atol=1e-7)


def test_the_step_maximises_the_penalised_likelihood() -> None:
    X, Y = points_of(shape("S")), shape("S") + np.array([0.02, 0.01, 0.0])
    config = replace(PLIABLE, max_iterations=1, tau_per_m2=1e6)
    W = register(X, Y, config).coefficients
    sigma2, G = config.initial_sigma_m**2, kernel(Y, config.beta_m)
    M = structure_matrix(lle_weights(Y, config.neighbours, config.regularisation))
    P1, _, PX = expectation(X, Y, sigma2, config.outlier_weight)

    def cost(W: NDArray[np.float64]) -> float:
        T = Y + G @ W
        fit = P1 @ np.sum(T**2, axis=1) - 2.0 * np.sum(PX * T)
        smooth = config.lambda_per_m2 * np.trace(W.T @ G @ W)
        return float(fit / sigma2 + smooth + config.tau_per_m2 * np.trace(T.T @ M @ T)) / 2.0

    rng = np.random.default_rng(0)
    best = cost(W)
    for _ in range(20):
        assert cost(W + 1e-3 * rng.normal(size=W.shape)) > best


def test_it_keeps_the_local_structure_over_a_gap_better_than_cpd() -> None:
    rod = shape("S")
    prior = state(rod + np.array([0.01, 0.015, 0.0]))  # 1.8 cm, mostly along the rod
    seen = cloud(rod, hidden=(0.4, 0.6))
    W = lle_weights(prior.nodes_world, 6, 1e-3)

    def broken_m(nodes: NDArray[np.float64]) -> float:
        return float(np.sqrt(np.mean(np.sum((nodes - W @ nodes) ** 2, axis=1))))

    spr, drifted = (one.estimate(seen, prior).nodes_world for one in (Spr(PLIABLE), Cpd(PLIABLE_CPD)))
    assert broken_m(spr) < 0.7 * broken_m(drifted)
    assert rmse_m(spr, rod) < 0.7 * rmse_m(drifted, rod)


def test_annealing_restarts_with_every_cloud() -> None:
    rod = shape("U")
    strategy, prior = Spr(), state(rod + np.array([0.015, 0.0, 0.0]))
    first = strategy.estimate(cloud(rod), prior).nodes_world
    for seed in range(1, 4):
        strategy.estimate(cloud(rod, seed), prior)
    np.testing.assert_array_equal(strategy.estimate(cloud(rod), prior).nodes_world, first)


def test_annealing_does_not_compound_over_iterations() -> None:
    X, Y = points_of(shape("S")), shape("S") + np.array([0.02, 0.01, 0.0])
    config = replace(PLIABLE, max_iterations=3, tau_annealing=0.5, lambda_annealing=0.25, tolerance=0.0)
    three = register(X, Y, config)
    two = register(X, Y, replace(config, max_iterations=2))
    G = kernel(Y, config.beta_m)
    M = structure_matrix(lle_weights(Y, config.neighbours, config.regularisation))
    sigma2, T = float(two.sigma2[-1]), two.nodes
    P1, _, PX = expectation(X, T, sigma2, config.outlier_weight)
    # The third iteration: to the power of two, where compounding would have reached the power of three.
    tau, lambda_ = 0.5**2 * config.tau_per_m2, 0.25**2 * config.lambda_per_m2
    A = np.diag(P1) @ G + lambda_ * sigma2 * np.eye(len(Y)) + tau * sigma2 * M @ G
    W = np.linalg.solve(A, PX - np.diag(P1) @ Y - tau * sigma2 * M @ Y)
    np.testing.assert_allclose(three.nodes, Y + G @ W, atol=1e-6)  # rounding of an ill-conditioned system


def test_ten_times_the_weight_keeps_more_of_the_structure() -> None:
    rod = shape("S")
    prior = state(rod + np.array([0.0, 0.02, 0.0]))
    seen = cloud(rod, outliers=0.1)
    M = structure_matrix(lle_weights(prior.nodes_world, 10, 1e-3))
    costs: list[float] = []
    for tau in (1e5, 1e6, 1e7, 1e8):
        T = Spr(replace(PLIABLE, tau_per_m2=tau)).estimate(seen, prior).nodes_world
        costs.append(float(np.trace(T.T @ M @ T)))
    assert costs == sorted(costs, reverse=True)
