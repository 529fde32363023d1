"""Planners and observers, chosen by name, are compared on the same start shapes."""

from dataclasses import replace

import pytest

from dlokit.errors import ConfigError
from dlokit.extras.bench.shaping.cases import ShapingMethod, cases, methods_of, with_method
from dlokit.extras.bench.shaping.suites import paper_suite
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.system.config import RunConfig


def test_every_method_runs_from_every_start_shape() -> None:
    methods = methods_of(RunConfig(), ["map", "cpd"], ["farthest", "rollout"])
    todo = list(cases(paper_suite(), 3, methods, first_seed=100))
    assert len(todo) == len(paper_suite()) * 3 * 4
    met = {method: {(case.experiment.name, case.seed) for case in todo if case.method == method} for method in methods}
    assert len(met) == 4
    assert len({frozenset(starts) for starts in met.values()}) == 1
    assert {case.seed for case in todo} == {100, 101, 102}


def test_by_default_the_configuration_is_the_method() -> None:
    config = RunConfig()
    (method,) = methods_of(config, [], [])
    assert method == ShapingMethod(observer=config.observer.strategy.name, planner=config.planning.strategy.name)
    assert with_method(config, method) == config


def test_a_configured_strategy_keeps_its_settings_and_others_have_defaults() -> None:
    config = RunConfig()
    config = replace(config, observer=replace(config.observer, strategy=CpdConfig(beta_m=0.3)))
    planner = config.planning.strategy.name
    assert with_method(config, ShapingMethod(observer="cpd", planner=planner)).observer.strategy == CpdConfig(
        beta_m=0.3
    )
    assert with_method(config, ShapingMethod(observer="map", planner=planner)).observer.strategy.name == "map"
    assert with_method(config, ShapingMethod(observer="map", planner="rollout")).planning.strategy.name == "rollout"


def test_an_unknown_method_is_refused_with_the_known_methods() -> None:
    with pytest.raises(ConfigError, match="farthest"):
        with_method(RunConfig(), ShapingMethod(observer="map", planner="crystal_ball"))
