"""Planners and observers, chosen by name, are compared on the same start shapes."""

from dataclasses import replace

import numpy as np
import pytest

from dlokit.communication.container import Container
from dlokit.communication.timing import virtual_time
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError
from dlokit.extras.bench.shaping.cases import ShapingMethod, cases, methods_of, with_method
from dlokit.extras.bench.shaping.runner import build_of
from dlokit.extras.bench.shaping.suites import paper_suite, posts_suite
from dlokit.rod.believed import topology
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.planning import api as planning
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.system.build import Build, Wiring
from dlokit.system.config import RunConfig
from dlokit.types.action import Marks
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.outcome import Succeeded
from dlokit.types.passing import SideWish


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


def test_every_method_runs_a_second_time_without_the_fixtures() -> None:
    methods = methods_of(RunConfig(), ["map"], ["farthest", "rollout"], blind=True)
    assert [(method.planner, method.blind) for method in methods] == [
        ("farthest", False),
        ("farthest", True),
        ("rollout", False),
        ("rollout", True),
    ]
    folders = {case.folder_name for case in cases(posts_suite()[:1], 1, methods)}
    assert len({method.name for method in methods}) == len(folders) == 4


def test_a_blind_planner_plans_as_on_a_bare_table_though_the_goal_names_posts() -> None:
    config = posts_suite()[0].configured(RunConfig())
    short = RolloutConfig(search=SearchConfig(rollouts=96, finalists=2, generations=2))
    config = replace(config, planning=replace(config.planning, strategy=short))
    bare = replace(config, installation=replace(config.installation, fixtures=()), beside="")
    aware, blind = (build_of(ShapingMethod(observer="map", planner="rollout", blind=one)) for one in (False, True))

    def predicted(build: Build, config: RunConfig, wish: tuple[SideWish, ...]) -> Float64Array:
        async def main() -> Float64Array:
            wiring = Wiring()
            host = Container(wiring.transport, wiring.clock)
            host.add(build("planning", config, wiring))
            start, goal = (
                builtin_shape(name, config.model.length_m, config.model.nodes, radius_m=config.model.radius_m)
                for name in ("I", "S")
            )
            shape = DloState(stamp_ns=0, nodes_world=start, topology=topology(config.model))
            marks = Marks(invalid_nodes=np.zeros(0, dtype=np.int64))
            asked = GoalShape(stamp_ns=0, nodes_world=goal, beside=wish)
            async with host:
                found = await host.transport.call(planning.PROPOSE, shape, asked, marks, 0)
            assert isinstance(found, Succeeded)
            assert found.result.predicted_nodes_world is not None
            return found.result.predicted_nodes_world

        return virtual_time.run(main())

    without = predicted(blind, config, config.wish)
    np.testing.assert_array_equal(without, predicted(aware, bare, ()))
    assert not np.array_equal(without, predicted(aware, config, config.wish))
