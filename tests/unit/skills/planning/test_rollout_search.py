"""The search of `rollout`: its budget, its finalists, its progress messages."""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ParamSpec, TypeVar

import numpy as np
import pytest
from rollout_bench import I_SHAPE, MODEL, S_SHAPE, SHORT, scene, tools

from dlokit.communication.port import InlineCompute
from dlokit.rod.believed import BeliefConfig
from dlokit.rod.rollout import RolloutResult
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.rollout.candidates import PlanningScene
from dlokit.skills.planning.rollout.carrying import Carrying
from dlokit.skills.planning.rollout.laying import Laying
from dlokit.skills.planning.rollout.pushing import Pushing
from dlokit.skills.planning.rollout.score import remaining_m
from dlokit.skills.planning.rollout.search import Choice, Scoring, Search, SearchConfig, SearchWatch, uncertain_rods
from dlokit.types.action import Action, Drag, LayDown, PickPlace, Push
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

P = ParamSpec("P")
R = TypeVar("R")


class TimedCompute(InlineCompute):
    """Computes at once, on a machine whose clock advances for each rollout."""

    def __init__(self, seconds_each: float) -> None:
        self.now_s = 0.0
        self._each_s = seconds_each

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        played = await super().__call__(function, *args, **kwargs)
        assert isinstance(played, RolloutResult)
        self.now_s += self._each_s * played.nearest_m.size
        return played


def expected(scores_m: Float64Array) -> Float64Array:
    return scores_m[0]


def test_finalists_are_of_more_than_one_kind_where_there_are_others() -> None:
    asked: list[Sequence[type[Action]]] = []

    def score(played: RolloutResult, kinds: Sequence[type[Action]]) -> Float64Array:
        asked.append(kinds)
        return np.array([[0.02 if kind is Drag else 0.01 for kind in kinds]] * len(played.nearest_m))

    search = Search(I_SHAPE, MODEL, replace(SHORT, finalists=4), Scoring(score=score, judge=expected), InlineCompute())
    families = [Carrying(scene(), dragging=dragging) for dragging in (True, False)]
    asyncio.run(search.run(families, np.random.default_rng(0)))
    assert set(asked[-1]) == {Drag, PickPlace}


def test_the_search_keeps_its_budget_and_refinement_helps() -> None:
    def run(generations: int, rollouts: int) -> tuple[int, float]:
        config = SearchConfig(rollouts=rollouts, finalists=2, generations=generations)

        def score(played: RolloutResult, kinds: Sequence[type[Action]]) -> Float64Array:
            miss_m = np.zeros(len(kinds))
            return remaining_m(played, miss_m, S_SHAPE, MODEL.radius_m, FeasibilityConfig())

        search = Search(I_SHAPE, MODEL, config, Scoring(score=score, judge=expected), InlineCompute())
        found = asyncio.run(search.run([Carrying(scene(), dragging=False)], np.random.default_rng(0)))
        return search.spent, found[0].score_m

    few, first = run(1, 40)
    many, refined = run(3, 120)
    assert 20 < few <= 40
    assert 80 < many <= 120
    assert refined < first


def test_a_slow_machine_tries_every_family_and_ends_in_time() -> None:
    compute = TimedCompute(0.008)

    def reachable(pose: Pose) -> bool:
        compute.now_s += 0.0005
        return True

    tried: set[type[Action]] = set()

    def score(played: RolloutResult, kinds: Sequence[type[Action]]) -> Float64Array:
        tried.update(kinds)
        return np.ones_like(played.nearest_m)

    watch = SearchWatch(stopwatch=lambda: compute.now_s)
    search = Search(I_SHAPE, MODEL, SearchConfig(), Scoring(score=score, judge=expected), compute, watch, threads=2)
    here = PlanningScene(I_SHAPE, S_SHAPE, frozenset(), tools(reachable))
    families = [Laying(here, from_last=False), *(Carrying(here, dragging=dragging) for dragging in (True, False))]
    asyncio.run(search.run([*families, Pushing(here)], np.random.default_rng(0)))
    assert tried == {LayDown, PickPlace, Drag, Push}
    assert compute.now_s < 2.0 + 0.008 * 16  # one more batch: the clock counts one rollout at a time
    assert search.spent > 50  # of the 100 that fit in: the rest of the time is for checks of reachability


@pytest.mark.parametrize(("seconds_each", "others"), [(0.0, {LayDown}), (0.008, set[type[Action]]())])
def test_the_most_promising_kind_is_tried_first_and_others_only_if_time_allows(
    seconds_each: float, others: set[type[Action]]
) -> None:
    tried: list[type[Action]] = []

    def score(played: RolloutResult, kinds: Sequence[type[Action]]) -> Float64Array:
        tried.extend(kinds)
        return np.full_like(played.nearest_m, 0.02)

    compute = TimedCompute(seconds_each)
    least: dict[type[Action], float] = {LayDown: 0.02, PickPlace: 0.01, Drag: 0.0}
    scoring = Scoring(score=score, judge=expected, least_m=lambda kind: least[kind])
    watch = SearchWatch(stopwatch=lambda: compute.now_s)
    search = Search(I_SHAPE, MODEL, SearchConfig(), scoring, compute, watch, threads=2)
    families = [Laying(scene(), from_last=False), *(Carrying(scene(), dragging=dragging) for dragging in (False, True))]
    asyncio.run(search.run(families, np.random.default_rng(0)))
    assert tried[0] is Drag
    assert set(tried) == {Drag, PickPlace, *others}


def test_progress_has_the_best_of_each_kind_and_node_best_first() -> None:
    told = list[list[Choice]]()

    async def tell(rollouts: int, best: Sequence[Choice]) -> None:
        told.append(list(best))

    def score(played: RolloutResult, kinds: Sequence[type[Action]]) -> Float64Array:
        return np.linalg.norm(played.nodes_world[:, :, 0] - S_SHAPE[0], axis=-1)

    config = SearchConfig(rollouts=100)
    search = Search(
        I_SHAPE, MODEL, config, Scoring(score=score, judge=expected), InlineCompute(), SearchWatch(tell=tell)
    )
    families = [
        Carrying(PlanningScene(I_SHAPE, S_SHAPE, frozenset(), tools()), dragging=dragging) for dragging in (True, False)
    ]
    asyncio.run(search.run(families, np.random.default_rng(0)))
    for best in told:
        grasps = [(choice.candidate.kind, choice.candidate.motion.node) for choice in best]
        assert len(set(grasps)) == len(grasps)
        assert [choice.score_m for choice in best] == sorted(choice.score_m for choice in best)
    assert len(told[-1]) == 6


@pytest.mark.parametrize(("log_sd", "factor"), [(0.1, 1.4), (math.log(3.0), 3.0)])
def test_finalists_are_simulated_with_rods_sampled_from_the_belief(log_sd: float, factor: float) -> None:
    sure = BeliefConfig(stiffness_log_sd=log_sd, friction_log_sd=0.0)
    rods = uncertain_rods(sure)
    assert len(rods) == 8
    assert {round(rod.stiffness_factor, 9) for rod in rods} == {round(1.0 / factor, 9), round(factor, 9)}
    assert {rod.friction_factor for rod in rods} == {1.0 / 1.4, 1.4}
