"""The strategy `rollout`: candidates, score, search."""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ParamSpec, TypeVar

import numpy as np
import pytest

from dlokit import geometry
from dlokit.communication import codec
from dlokit.communication.compute import InlineCompute
from dlokit.description.dlo import SILICONE_HOSE, SOFT_ROPE, WIRE_B
from dlokit.description.shapes import builtin_shape, moved
from dlokit.errors import ConfigError
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.quick_rollout import Played, QuickRod, play
from dlokit.skills.model.rod import topology
from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.rollouts.candidates import Candidate, Scene, to_action
from dlokit.skills.planning.rollouts.carrying import Carrying
from dlokit.skills.planning.rollouts.laying import Laying
from dlokit.skills.planning.rollouts.pushing import Pushing
from dlokit.skills.planning.rollouts.score import ScoreConfig, cautious_m, remaining_m
from dlokit.skills.planning.rollouts.search import Choice, Search, SearchConfig, Watch
from dlokit.skills.planning.rollouts.strategy import RolloutConfig
from dlokit.types.action import Action, Drag, LayDown, Marks, PickPlace, Push, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose

P = ParamSpec("P")
R = TypeVar("R")
MODEL = ModelConfig()
I_SHAPE = builtin_shape("I", MODEL.length_m, MODEL.nodes)
S_SHAPE = builtin_shape("S", MODEL.length_m, MODEL.nodes)
SHORT = SearchConfig(rollouts=70, finalists=2, generations=1)


def tools(reachable: Callable[[Pose], bool] = lambda T: True) -> PlanningTools:
    return PlanningTools(reachable=reachable, actions=ActionConfig(), model=MODEL)


def scene(goal: Float64Array = S_SHAPE, marked: tuple[int, ...] = ()) -> Scene:
    return Scene(I_SHAPE, goal, frozenset(marked), tools())


def best(config: RolloutConfig, start: Float64Array, goal: Float64Array) -> Action:
    async def first() -> Action:
        shape = DloState(stamp_ns=0, nodes_world=start, topology=topology(MODEL))
        marks = Marks(invalid_nodes=np.zeros(0, dtype=np.int64))
        proposals = config.build(tools()).propose(shape, GoalShape(stamp_ns=0, nodes_world=goal), marks)
        return await anext(aiter(proposals))

    return asyncio.run(first())


def lying(*shapes: Float64Array, nearest_m: float = 0.1) -> Played:
    return Played(nodes_world=np.stack(shapes)[None], nearest_m=np.full((1, len(shapes)), nearest_m))


def scored(played: Played, config: ScoreConfig | None = None, goal: Float64Array = S_SHAPE) -> Float64Array:
    miss_m = np.zeros(played.nearest_m.shape[1])
    return remaining_m(played, miss_m, goal, MODEL.radius_m, config or ScoreConfig(), FeasibilityConfig())[0]


def test_a_far_rod_is_laid_down_whole_and_expected_near_its_goal() -> None:
    goal = moved(I_SHAPE, (0.06, 0.1375), 0.7)
    action = best(RolloutConfig(search=SearchConfig(rollouts=160)), I_SHAPE, goal)
    assert isinstance(action, LayDown)
    assert action.predicted_nodes_world is not None
    # The farthest node taken to its goal leaves 10 cm; so short a search a quarter of that.
    assert geometry.rmse_m(action.predicted_nodes_world, goal) < 0.025


def test_a_rod_near_its_goal_is_corrected_and_not_laid_down_anew() -> None:
    start = S_SHAPE.copy()
    start[:8, 0] += 0.02 * np.linspace(1.0, 0.0, 8)
    action = best(RolloutConfig(search=SHORT), start, S_SHAPE)
    assert isinstance(action, PickPlace | Drag | Push)
    assert action.grasp.node < 12


@pytest.mark.parametrize("kind", ["pick_place", "drag", "lay_down", "push"])
def test_kinds_can_be_left_out(kind: str) -> None:
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


def test_every_kind_travels_over_the_bus_as_what_it_is() -> None:
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


def test_a_lay_down_ends_with_the_held_end_at_its_goal_and_the_rest_behind_it() -> None:
    for from_last, node in ((False, 0), (True, 30)):
        family = Laying(scene(), from_last=from_last)
        candidate = family.make(family.first(1, np.random.default_rng(0))[0])
        assert candidate is not None
        assert candidate.motion.node == node
        tool = candidate.motion.waypoints
        assert np.linalg.norm(tool[-1, :2] - S_SHAPE[node, :2]) < 0.013  # held 12 mm from the end
        assert np.linalg.norm(tool[2, :2] - S_SHAPE[30 - node, :2]) < 0.05  # it starts above the other end, with a lead
        assert np.all(np.diff(tool[2:, 2]) < 0.0)


def test_a_lay_down_that_missed_is_aimed_better() -> None:
    family, errors_m = Laying(scene(), from_last=True), list[float]()
    numbers = family.first(1, np.random.default_rng(0))[0]
    for _ in range(4):
        candidate = family.make(numbers)
        assert candidate is not None
        nodes = play(MODEL, I_SHAPE, (QuickRod(),), (candidate.motion,), 0.01).nodes_world[0, 0]
        errors_m.append(geometry.rmse_m(nodes, S_SHAPE))
        numbers = family.aimed(candidate.numbers, nodes)
    assert errors_m[-1] < 0.35 * errors_m[0]


def test_a_carry_that_fell_short_is_released_farther() -> None:
    family = Carrying(scene(), dragging=True)
    numbers = family.first(1, np.random.default_rng(0))[0]
    short = S_SHAPE - np.array([0.01, 0.0, 0.0])
    more = family.aimed(numbers, short) - numbers
    assert more[1] > 0.005
    assert np.abs(np.delete(more, 1)).max() == 0.0


def test_where_the_end_is_marked_the_next_node_is_held() -> None:
    family = Laying(scene(marked=(0,)), from_last=False)
    candidate = family.make(family.first(1, np.random.default_rng(0))[0])
    assert candidate is not None
    assert candidate.motion.node == 1


def push_of(direction_rad: float, length_m: float = 0.05, marked: tuple[int, ...] = ()) -> Candidate | None:
    return Pushing(scene(marked=marked)).make(np.array([0.5, direction_rad, 0.006, length_m, 0.0, 0.0, 0.15]))


@pytest.mark.parametrize("direction_rad", [0.0, np.pi])
def test_a_push_moves_the_middle_by_its_length_to_the_side_it_says(direction_rad: float) -> None:
    candidate = push_of(direction_rad)
    assert candidate is not None
    end = play(MODEL, I_SHAPE, (QuickRod(),), (candidate.motion,), 0.005).nodes_world[0, 0]
    along = geometry.tangents(I_SHAPE)[15, :2]
    way = np.cos(direction_rad) * np.array([-along[1], along[0]])
    # The spring of the fingers gives by a millimetre, and the bend that they leave by another.
    assert (end - I_SHAPE)[15, :2] @ way == pytest.approx(0.05, abs=0.004)
    assert np.linalg.norm((end - I_SHAPE)[[0, 30]], axis=1).max() < 0.02


def test_a_push_along_the_rod_onto_it_or_at_a_marked_node_is_none() -> None:
    assert push_of(1.3) is None
    assert push_of(0.0, marked=(15,)) is None
    assert push_of(0.0, length_m=-0.01) is None
    hairpin = np.concatenate((I_SHAPE[:16], I_SHAPE[:15][::-1] + np.array([0.02, 0.0, 0.0])))
    beside = Pushing(Scene(hairpin, S_SHAPE, frozenset(), tools()))
    tries = [beside.make(np.array([0.25, way, 0.006, 0.05, 0.0, 0.0, 0.15])) for way in (0.0, np.pi)]
    assert [made is None for made in tries].count(True) == 1, "on one side lies the other strand"


def test_a_waypoint_out_of_reach_makes_no_candidate() -> None:
    low = Scene(I_SHAPE, S_SHAPE, frozenset(), tools(lambda T: float(T.position_m[2]) < 0.3))
    family = Laying(low, from_last=False)
    assert family.make(family.first(1, np.random.default_rng(0))[0]) is None


def test_of_two_shapes_with_one_error_that_is_better_whose_error_sits_in_one_place() -> None:
    here, everywhere = S_SHAPE.copy(), S_SHAPE.copy()
    here[:6, 0] += 0.03
    everywhere[:, 0] += geometry.rmse_m(here, S_SHAPE)
    score = scored(lying(here, everywhere))
    assert score[0] < score[1] - 0.002
    without = scored(lying(here, everywhere), ScoreConfig(next_action=0.0))
    assert without[0] == pytest.approx(without[1])


def test_a_tangle_and_a_rod_off_the_table_are_dear() -> None:
    off = S_SHAPE + np.array([0.3, 0.0, 0.0])
    clean, crossed, outside = (
        scored(lying(S_SHAPE))[0],
        scored(lying(S_SHAPE, nearest_m=0.008))[0],  # as near as a diameter: one strand went through another
        scored(lying(off))[0],
    )
    assert crossed > clean + 0.2
    assert outside > geometry.rmse_m(off, S_SHAPE) + 0.05


def test_a_doubtful_action_counts_for_less_than_a_sure_one_of_the_same_mean() -> None:
    scores = np.array([[0.01, 0.02], [0.03, 0.02]])
    assert cautious_m(scores, 0.0)[0] == pytest.approx(cautious_m(scores, 0.0)[1])
    assert cautious_m(scores, 1.0)[0] > cautious_m(scores, 1.0)[1]


def test_a_lay_down_must_promise_more_than_a_small_correction_because_it_misses_by_more() -> None:
    config = ScoreConfig()
    assert config.miss_m(LayDown, MODEL) > config.miss_m(PickPlace, MODEL) > config.miss_m(Drag, MODEL)
    near = lying(S_SHAPE + np.array([0.004, 0.0, 0.0]))
    score = [
        remaining_m(near, np.array([config.miss_m(kind, MODEL)]), S_SHAPE, MODEL.radius_m, config, FeasibilityConfig())[
            0, 0
        ]
        for kind in (LayDown, Drag)
    ]
    assert score[0] > score[1] + 0.004


def test_a_dlo_that_does_not_drape_is_not_expected_to_be_laid_down_well() -> None:
    config = ScoreConfig()
    rope, hose, wire = (
        replace(MODEL, bending_stiffness_n_m2=preset.bending_stiffness_n_m2, mass_kg_m=preset.mass_per_length_kg_m)
        for preset in (SOFT_ROPE, SILICONE_HOSE, WIRE_B)
    )
    assert config.miss_m(LayDown, rope) == config.lay_down_miss_m
    assert config.miss_m(LayDown, hose) > 2.0 * config.lay_down_miss_m
    assert config.miss_m(LayDown, wire) > 2.0 * config.miss_m(LayDown, hose)
    assert config.miss_m(Drag, wire) == config.miss_m(Drag, rope)


def test_finalists_are_of_more_than_one_kind_where_there_are_others() -> None:
    asked: list[Sequence[type[Action]]] = []

    def score(played: Played, kinds: Sequence[type[Action]]) -> Float64Array:
        asked.append(kinds)
        return np.array([[0.02 if kind is Drag else 0.01 for kind in kinds]] * len(played.nearest_m))

    search = Search(I_SHAPE, MODEL, replace(SHORT, finalists=4), score, lambda scores: scores[0], InlineCompute())
    families = [Carrying(scene(), dragging=dragging) for dragging in (True, False)]
    asyncio.run(search.run(families, np.random.default_rng(0)))
    assert set(asked[-1]) == {Drag, PickPlace}


def test_the_search_keeps_to_its_budget_and_refining_helps() -> None:
    def run(generations: int, rollouts: int) -> tuple[int, float]:
        config = SearchConfig(rollouts=rollouts, finalists=2, generations=generations)

        def score(played: Played, kinds: Sequence[type[Action]]) -> Float64Array:
            miss_m = np.zeros(len(kinds))
            return remaining_m(played, miss_m, S_SHAPE, MODEL.radius_m, ScoreConfig(), FeasibilityConfig())

        search = Search(I_SHAPE, MODEL, config, score, lambda scores: scores[0], InlineCompute())
        found = asyncio.run(search.run([Carrying(scene(), dragging=False)], np.random.default_rng(0)))
        return search.spent, found[0].score_m

    few, first = run(1, 40)
    many, refined = run(3, 120)
    assert 20 < few <= 40
    assert 80 < many <= 120
    assert refined < first


def test_a_slow_machine_tries_every_family_and_ends_in_time() -> None:
    now_s = [0.0]

    class SlowCompute(InlineCompute):
        async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
            played = await super().__call__(function, *args, **kwargs)
            assert isinstance(played, Played)
            now_s[0] += 0.008 * played.nearest_m.size
            return played

    def reachable(pose: Pose) -> bool:
        now_s[0] += 0.0005
        return True

    tried: set[type[Action]] = set()

    def score(played: Played, kinds: Sequence[type[Action]]) -> Float64Array:
        tried.update(kinds)
        return np.ones_like(played.nearest_m)

    watch = Watch(stopwatch=lambda: now_s[0])
    search = Search(I_SHAPE, MODEL, SearchConfig(threads=2), score, lambda scores: scores[0], SlowCompute(), watch)
    here = Scene(I_SHAPE, S_SHAPE, frozenset(), tools(reachable))
    families = [Laying(here, from_last=False), *(Carrying(here, dragging=dragging) for dragging in (True, False))]
    asyncio.run(search.run([*families, Pushing(here)], np.random.default_rng(0)))
    assert tried == {LayDown, PickPlace, Drag, Push}
    assert now_s[0] < 2.0 + 0.008 * 16  # a batch more: the clock counts one rollout at a time
    assert search.spent > 50  # of the 100 that fit in: what takes the rest is whether the arm reaches


def test_who_watches_is_told_the_best_of_each_kind_and_node_best_first() -> None:
    told = list[list[Choice]]()

    async def tell(rollouts: int, best: Sequence[Choice]) -> None:
        told.append(list(best))

    def score(played: Played, kinds: Sequence[type[Action]]) -> Float64Array:
        return np.linalg.norm(played.nodes_world[:, :, 0] - S_SHAPE[0], axis=-1)

    config = SearchConfig(rollouts=100, threads=2)
    search = Search(I_SHAPE, MODEL, config, score, lambda scores: scores[0], InlineCompute(), Watch(tell=tell))
    families = [
        Carrying(Scene(I_SHAPE, S_SHAPE, frozenset(), tools()), dragging=dragging) for dragging in (True, False)
    ]
    asyncio.run(search.run(families, np.random.default_rng(0)))
    for best in told:
        grasps = [(choice.candidate.kind, choice.candidate.motion.node) for choice in best]
        assert len(set(grasps)) == len(grasps)
        assert [choice.score_m for choice in best] == sorted(choice.score_m for choice in best)
    assert len(told[-1]) == 6


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ConfigError, match="too short"):
        SearchConfig(rollouts=30)
    with pytest.raises(ConfigError, match="doubt"):
        SearchConfig(doubt=0.5)
    for seconds in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigError, match="seconds"):
            SearchConfig(seconds=seconds)
    assert SearchConfig(doubt=1.0).doubtful_rods == ()
