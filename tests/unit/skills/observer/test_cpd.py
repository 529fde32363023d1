"""Coherent point drift against its paper and against another implementation."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from synthetic_clouds import cloud, shape, state

from dlokit.errors import ConfigError
from dlokit.skills.observer.cpd import Cpd, CpdConfig, register
from dlokit.skills.observer.mixture import initial_sigma2, kernel

FAITHFUL = CpdConfig(
    beta_m=0.12,  # an I must be able to become an S
    lambda_per_m2=300.0,
    outlier_weight=0.05,
    initial_sigma_m=0,
    smallest_sigma_m=1e-6,
    tolerance=0.0,
    max_iterations=30,
)


def test_it_agrees_with_pycpd_on_the_same_cloud() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)  # pycpd compares with `is not`
        pycpd = pytest.importorskip("pycpd", reason="pycpd comes with the extra `bench`")
    X = cloud(shape("S")).points_world[:400].astype(np.float64)
    Y = shape("I")
    ours = register(X, Y, FAITHFUL)
    theirs = pycpd.DeformableRegistration(
        X=X,
        Y=Y,
        alpha=FAITHFUL.lambda_per_m2,
        beta=FAITHFUL.beta_m,
        w=FAITHFUL.outlier_weight,
        max_iterations=30,
        tolerance=0.0,
    )
    nodes, _ = theirs.register()
    # The same equations in another order of operations, 30 times over: rounding only, far below 1 um.
    np.testing.assert_allclose(ours.nodes, nodes, atol=1e-7)
    assert ours.sigma2[-1] == pytest.approx(theirs.sigma2, rel=1e-4)


def test_the_variance_starts_as_the_mean_over_all_pairs_and_falls() -> None:
    X, Y = cloud(shape("S")).points_world.astype(np.float64), shape("I")
    pairs = np.sum((X[:, None] - Y[None]) ** 2, axis=2)
    assert initial_sigma2(X, Y) == pytest.approx(pairs.mean() / 3, rel=1e-9)
    sigma2 = register(X, Y, FAITHFUL).sigma2
    # The penalty's weight changes with sigma², so that at the end it may creep up again, by less than a thousandth.
    assert np.all(np.diff(sigma2) <= 1e-3 * sigma2[:-1])
    assert sigma2[-1] < 0.01 * sigma2[0]


@pytest.mark.parametrize("bad", [{"lambda_per_m2": 0.0}, {"beta_m": 0.0}, {"outlier_weight": 1.0}])
def test_settings_without_a_solution_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(bad)).replace("_", "-")):
        replace(CpdConfig(), **bad)


def test_the_kernel_is_one_on_the_diagonal_and_falls_with_distance() -> None:
    G = kernel(shape("I"), 0.1)
    np.testing.assert_allclose(np.diag(G), 1.0)
    assert np.all(np.diff(G[0]) < 0)


def test_outliers_do_not_pull_the_nodes() -> None:
    rod = shape("S")
    clean, dirty = cloud(rod, outliers=0.0), cloud(rod, outliers=0.1)
    nodes = Cpd().estimate(clean, state(rod)).nodes_world
    pulled = Cpd().estimate(dirty, state(rod)).nodes_world
    # Ten per cent of strays within 5 cm, which would pull by centimetres: less than a node spacing (17 mm) may slide.
    assert np.sqrt(np.mean(np.sum((nodes - pulled) ** 2, axis=1))) < 0.012


def test_hidden_nodes_move_coherently() -> None:
    rod = shape("I")
    seen = cloud(rod + np.array([0.02, 0.0, 0.0]), hidden=(0.4, 0.6), outliers=0.0)
    result = Cpd().estimate(seen, state(rod))
    hidden = ~result.visible
    assert 3 <= hidden.sum() <= 8  # 20 % of 31 nodes is 6; those at the rim still have points within 15 mm
    # They move with the others, 2 cm along x, and not towards the ends of the gap.
    np.testing.assert_allclose(result.nodes_world[hidden, 0] - rod[hidden, 0], 0.02, atol=0.003)


def test_an_empty_cloud_returns_the_prior_with_zero_health() -> None:
    rod = shape("S")
    result = Cpd().estimate(cloud(rod, count=0), state(rod))
    np.testing.assert_array_equal(result.nodes_world, rod)
    assert not result.visible.any()
    assert result.health == 0.0
