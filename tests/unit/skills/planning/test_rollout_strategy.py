"""The strategy `rollout`: from a shape and a goal to one action."""

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest
from rollout_bench import I_SHAPE, MODEL, S_SHAPE, SHORT, scene, tools

from dlokit import geometry
from dlokit.communication.wire import codec
from dlokit.description.scene import NO_FIXTURES, Post, Scene
from dlokit.description.shapes import moved
from dlokit.errors import ConfigError
from dlokit.rod.believed import topology
from dlokit.skills.planning.rollout.candidates import to_action
from dlokit.skills.planning.rollout.carrying import Carrying
from dlokit.skills.planning.rollout.laying import Laying
from dlokit.skills.planning.rollout.pushing import Pushing
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.types.action import Action, Drag, LayDown, Marks, PickPlace, Push, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape


def best(config: RolloutConfig, start: Float64Array, goal: Float64Array, among: Scene = NO_FIXTURES) -> Action:
    async def first() -> Action:
        shape = DloState(stamp_ns=0, nodes_world=start, topology=topology(MODEL))
        marks = Marks(invalid_nodes=np.zeros(0, dtype=np.int64))
        proposals = config.build(replace(tools(), scene=among)).propose(
            shape, GoalShape(stamp_ns=0, nodes_world=goal), marks
        )
        return await anext(aiter(proposals))

    return asyncio.run(first())


def test_a_far_rod_is_laid_down_as_a_whole_and_predicted_near_its_goal() -> None:
    goal = moved(I_SHAPE, (0.06, 0.1375), 0.7)
    action = best(RolloutConfig(search=SearchConfig(rollouts=160)), I_SHAPE, goal)
    assert isinstance(action, LayDown)
    assert action.predicted_nodes_world is not None
    # Moving the farthest node to its goal leaves 10 cm; this short search leaves a quarter of that.
    assert geometry.rmse_m(action.predicted_nodes_world, goal) < 0.025


def test_predictions_of_a_search_lead_around_the_posts_of_the_scene() -> None:
    start = I_SHAPE - np.array([0.03, 0.0, 0.0])
    wall = tuple(
        Post(name=f"p{n}", position_m=(float(I_SHAPE[n, 0]) - 0.012, float(I_SHAPE[n, 1]), 0.0))
        for n in range(3, 30, 3)
    )
    config = RolloutConfig(search=SHORT, lay_down=False, pick_place=False)
    predicted = best(config, start, I_SHAPE, Scene(fixtures=wall)).predicted_nodes_world
    assert predicted is not None
    places = np.array([post.position_m[:2] for post in wall])
    apart_m = np.linalg.norm(geometry.resample(predicted, 1000)[:, None, :2] - places, axis=2).min()
    assert apart_m > 0.005 + MODEL.radius_m - 0.001


def test_a_rod_near_its_goal_is_corrected_and_not_laid_down_again() -> None:
    start = S_SHAPE.copy()
    start[:8, 0] += 0.02 * np.linspace(1.0, 0.0, 8)
    action = best(RolloutConfig(search=SHORT), start, S_SHAPE)
    assert isinstance(action, PickPlace | Drag | Push)
    assert action.grasp.node < 12


@pytest.mark.parametrize("kind", ["pick_place", "drag", "lay_down", "push"])
def test_kinds_can_be_disabled(kind: str) -> None:
    config = RolloutConfig(
        search=SHORT,
        pick_place=kind == "pick_place",
        drag=kind == "drag",
        lay_down=kind == "lay_down",
        push=kind == "push",
    )
    action = best(config, I_SHAPE, moved(I_SHAPE, (0.05, 0.02)))
    names = {"pick_place": "pick-and-place", "drag": "drag", "lay_down": "lay-down", "push": "push"}
    assert kind_of(action) == names[kind]


def test_every_kind_keeps_its_type_over_the_bus() -> None:
    families = (
        Carrying(scene(), dragging=False),
        Carrying(scene(), dragging=True),
        Laying(scene(), from_last=True),
        Pushing(scene()),
    )
    for family in families:
        made = (family.make(numbers) for numbers in family.first(20, np.random.default_rng(0)))
        candidate = next(candidate for candidate in made if candidate is not None)
        action = to_action(candidate, 7, S_SHAPE, tools())
        back = codec.decode(codec.encode(action), Action)  # type: ignore[arg-type]  # a union, which decodes like a type
        assert type(back) is family.kind


def test_invalid_settings_are_refused() -> None:
    with pytest.raises(ConfigError, match="it must be 80 or greater"):
        SearchConfig(rollouts=30)
    for seconds in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigError, match="seconds"):
            SearchConfig(seconds=seconds)
