"""What every observer holds to, ours and installed ones; a new observer is tested by being installed."""

import dataclasses

import msgspec
import numpy as np
import pytest

from dlokit.communication import codec
from dlokit.geometry import resample
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.strategies import from_spec, strategies, to_spec
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

LENGTH_M = 0.5
OBSERVERS = list(strategies().values())


def rod(count: int) -> np.ndarray:
    """A bow on the table."""
    t = np.linspace(-1.0, 1.0, 200)
    return resample(np.column_stack([0.5 - 0.05 * t**2, 0.24 * t, np.full(200, 0.004)]), count)


def observation(shift_m: float = 0.0, count: int = 900) -> Observation:
    rng = np.random.default_rng(0)
    points = resample(rod(400), max(count, 1))[:count] + rng.normal(0.0, 0.002, (count, 3))
    points[:, 0] += shift_m
    return Observation(stamp_ns=77, points_world=points.astype(np.float32))


def prior(count: int) -> DloState:
    return DloState(stamp_ns=5, nodes_world=rod(count), topology=chain(count, LENGTH_M))


def make(config: type[ObserverStrategyConfig]):
    return config().build()


pytestmark = pytest.mark.parametrize("config", OBSERVERS, ids=[config.name for config in OBSERVERS])


@pytest.mark.parametrize("count", [10, 31, 51])
def test_targets_have_the_priors_nodes_and_the_clouds_stamp(config: type[ObserverStrategyConfig], count: int) -> None:
    targets = make(config).estimate(observation(0.02), prior(count))
    assert targets.nodes_world.shape == (count, 3)
    assert targets.nodes_world.dtype == np.float64
    assert np.isfinite(targets.nodes_world).all()
    assert targets.visible.shape == (count,)
    assert targets.stamp_ns == 77
    assert 0.0 <= targets.health <= 1.0


def test_targets_come_nearer_than_the_prior(config: type[ObserverStrategyConfig]) -> None:
    truth = rod(31) + np.array([0.03, 0.0, 0.0])
    targets = make(config).estimate(observation(0.03), prior(31))
    # 3 cm across the rod; even nodes that slide along it must end within half of that.
    assert np.sqrt(np.mean(np.sum((targets.nodes_world - truth) ** 2, axis=1))) < 0.015


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_hardly_any_points_are_no_error(config: type[ObserverStrategyConfig], count: int) -> None:
    targets = make(config).estimate(observation(count=count), prior(31))
    assert np.isfinite(targets.nodes_world).all()
    if count == 0:
        np.testing.assert_array_equal(targets.nodes_world, rod(31))
        assert not targets.visible.any()
        assert targets.health == 0.0


def test_arguments_stay_as_they_are_and_may_be_read_only(config: type[ObserverStrategyConfig]) -> None:
    seen = codec.decode(codec.encode(observation()), Observation)
    before = codec.decode(codec.encode(prior(31)), DloState)
    make(config).estimate(seen, before)
    np.testing.assert_array_equal(before.nodes_world, rod(31))


def test_the_same_arguments_give_the_same_targets(config: type[ObserverStrategyConfig]) -> None:
    strategy = make(config)
    first = strategy.estimate(observation(0.02), prior(31))
    strategy.estimate(observation(-0.03), prior(31))
    again = strategy.estimate(observation(0.02), prior(31))
    np.testing.assert_array_equal(first.nodes_world, again.nodes_world)


def test_targets_can_be_sent(config: type[ObserverStrategyConfig]) -> None:
    targets = make(config).estimate(observation(), prior(31))
    sent = codec.decode(codec.encode(targets), TargetPoints)
    np.testing.assert_array_equal(sent.nodes_world, targets.nodes_world)


def test_settings_are_frozen_and_travel(config: type[ObserverStrategyConfig]) -> None:
    settings = config()
    assert dataclasses.is_dataclass(settings)
    assert settings.__dataclass_params__.frozen  # pyright: ignore[reportAttributeAccessIssue]  # set by dataclass
    assert from_spec(to_spec(settings)) == settings
    assert msgspec.json.decode(to_spec(settings).settings) != {}
