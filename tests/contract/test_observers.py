"""The requirements of `dlokit.testing` on every observer, dlokit's and installed ones."""

from functools import partial

import pytest

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.strategies import OURS, from_spec, strategies, to_spec
from dlokit.testing.checks import Check, findings
from dlokit.testing.observer_checks import OBSERVER_CHECKS, Build, branched_off_m
from dlokit.testing.settings import settings_checks

OBSERVERS = list(strategies().values())

every_observer = pytest.mark.parametrize("config", OBSERVERS, ids=[config.name for config in OBSERVERS])


@every_observer
@pytest.mark.parametrize("check", OBSERVER_CHECKS, ids=lambda check: check.name)
def test_an_observer_conforms_to_the_protocol(config: type[ObserverStrategyConfig], check: Check[Build]) -> None:
    assert findings([check], partial(config().build, BelievedDlo())) == []


@every_observer
def test_its_settings_are_documented_and_survive_encoding(config: type[ObserverStrategyConfig]) -> None:
    assert findings(settings_checks("observer", dict(strategies())), config) == []
    assert from_spec(to_spec(config())) == config()


@pytest.mark.parametrize("config", OURS, ids=[config.name for config in OURS])
def test_built_in_observers_track_branched_dlos(config: type[ObserverStrategyConfig]) -> None:
    assert branched_off_m(partial(config().build, BelievedDlo())) is not None
