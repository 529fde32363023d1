"""The timing of one iteration: equal input for all methods, and the statistics."""

import numpy as np
import pytest

from dlokit.extras.bench.observers.iterations import (
    ITERATIONS,
    NODES,
    IterationTimes,
    cloud_and_nodes,
    figures,
    measure,
    ratio,
)


def _times(method: str, seconds: list[float]) -> IterationTimes:
    return IterationTimes(method=method, points=500, iterations_s=np.array(seconds), setups_s=np.array([1e-3]))


def test_every_iteration_of_every_method_is_timed() -> None:
    times = measure(points=(64, 128), repeats=2)
    assert {(one.method, one.points) for one in times} >= {("cpd", 64), ("cpd", 128)}
    assert all(len(one.iterations_s) == 2 * ITERATIONS and len(one.setups_s) == 2 for one in times)


def test_clouds_are_the_same_each_time_and_near_the_nodes() -> None:
    X, Y = cloud_and_nodes(500)
    np.testing.assert_array_equal(X, cloud_and_nodes(500)[0])
    assert X.shape == (500, 3)
    assert Y.shape == (NODES, 3)
    # Nodes are 2 cm off the curve, points 2 mm; one point in twenty may be anywhere.
    assert np.quantile(np.linalg.norm(X[:, None] - Y[None], axis=2).min(axis=1), 0.9) < 0.03


def test_ratios_are_of_iterations_that_ran_in_turn() -> None:
    # The second pair ran on a machine three times as slow: the ratio is 10 nevertheless.
    assert ratio(_times("pycpd", [1e-3, 3e-3]), _times("cpd", [1e-4, 3e-4])) == pytest.approx((10.0, 10.0, 10.0))


def test_rows_have_the_median_and_the_spread() -> None:
    rows = figures([_times("cpd", [1e-4] * 9 + [1e-3]), _times("pycpd", [2e-3] * 10)])
    found = {(row.method, row.metric): row for row in rows}
    assert found["cpd", "time an iteration"].value == pytest.approx(1e-4)
    assert found["pycpd", "time an iteration"].high == pytest.approx(2e-3)
    assert found["pycpd", "times cpd's"].value == pytest.approx(20.0)
    assert ("cpd", "times cpd's") not in found
