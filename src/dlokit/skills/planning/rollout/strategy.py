"""The strategy `rollout`: simulates candidates and selects the one with the smallest remaining error."""

from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dlokit.description.passing import wish_along
from dlokit.rod.rollout import RolloutResult, load_kernels
from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.skills.planning.pick_place import goal_in_order
from dlokit.skills.planning.rollout.candidates import Family, PlanningScene, to_action
from dlokit.skills.planning.rollout.carrying import Carrying
from dlokit.skills.planning.rollout.laying import Laying
from dlokit.skills.planning.rollout.pairing import Pairing
from dlokit.skills.planning.rollout.pushing import Pushing
from dlokit.skills.planning.rollout.score import (
    PredictionErrors,
    by_sides_m,
    cautious_m,
    least_remaining_m,
    remaining_m,
    usual_error_m,
)
from dlokit.skills.planning.rollout.search import Choice, Scoring, Search, SearchConfig, SearchWatch
from dlokit.types.action import Action, Candidates, Marks, ScoredCandidate, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape

_SEED = 0  # seed of the candidates, with the stamp of the shape: equal inputs give equal decisions


@dataclass(frozen=True, kw_only=True)
class RolloutConfig:
    """Simulates candidates of every kind in the model and selects the one with the smallest remaining error."""

    name: ClassVar[str] = "rollout"

    search: SearchConfig = field(default_factory=SearchConfig)
    """Number of simulated actions per decision."""
    pick_place: bool = True
    """Consider lifting the rod at a node, carrying it and putting it down."""
    drag: bool = True
    """Consider dragging the rod along the table."""
    lay_down: bool = True
    """Consider laying the whole rod down along the goal."""
    push: bool = False
    """Consider pushing the rod sideways with closed fingers. Off, because a push is harder to predict."""
    pair: bool = True
    """Consider pairs of grasps, if there are two arms."""

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        return Rollout(self, tools)

    def load(self) -> float:
        """Compile and load the planning rod; returns the time that it took [s]."""
        return load_kernels()


class Rollout:
    """Simulates and refines candidates; see docs/explanations/planning.md."""

    def __init__(self, config: RolloutConfig, tools: PlanningTools) -> None:
        self._config, self._tools = config, tools
        self._errors = PredictionErrors(tools.model)

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """Actions of all kinds, ordered by remaining error; each with its predicted shape."""
        config, tools = self._config, self._tools
        goal_world = goal_in_order(shape.nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
        marked = frozenset(int(node) for node in marks.invalid_nodes)
        self._errors.compare(shape)
        # A planner that is compared without knowledge of the fixtures gets a goal that names them.
        sides = (goal.beside or wish_along(goal_world, tools.scene.fixtures)) if tools.scene.posts else ()
        scene = PlanningScene(shape.nodes_world, goal_world, marked, tools)

        def score(simulated: RolloutResult, kinds: Sequence[type[Action]]) -> Float64Array:
            error_m = np.array([self._errors.of(kind) for kind in kinds])
            left_m = remaining_m(simulated, error_m, goal_world, tools.model.radius_m, tools.table)
            if not sides:
                return left_m
            fixtures, either_way = tools.scene.fixtures, goal.ends_interchangeable and bool(goal.beside)
            return left_m + by_sides_m(simulated.nodes_world, sides, fixtures, ends_interchangeable=either_way)

        def least_m(kind: type[Action]) -> float:
            # The usual error: one failed action must not exclude its whole kind.
            return least_remaining_m(usual_error_m(kind, tools.model))

        async def tell(rollouts: int, best: Sequence[Choice]) -> None:
            seen = tuple(_seen(choice) for choice in best)
            await tools.tell(
                Candidates(stamp_ns=shape.stamp_ns, rollouts=rollouts, budget=config.search.rollouts, best=seen)
            )

        watch = SearchWatch(tell=tell, stopwatch=tools.stopwatch)
        scoring = Scoring(score=score, judge=cautious_m, least_m=least_m)
        posts = tools.scene.posts_world
        search = Search(shape.nodes_world, tools.model, config.search, scoring, tools.compute, watch, posts=posts)
        # Candidates depend on the stamp: an action that failed is not repeated unchanged.
        rng = np.random.default_rng([_SEED, shape.stamp_ns])
        for choice in await search.run(self._families(scene), rng):
            action = to_action(choice.candidate, shape.stamp_ns, choice.nodes_world, tools)
            self._errors.expect(action, shape)
            yield action

    def _families(self, scene: PlanningScene) -> list[Family]:
        config = self._config
        families: list[Family] = []
        if config.lay_down:
            families += [Laying(scene, from_last=False), Laying(scene, from_last=True)]
        if config.pick_place:
            families.append(Carrying(scene, dragging=False))
        if config.drag:
            families.append(Carrying(scene, dragging=True))
        if config.push:
            families.append(Pushing(scene))
        if config.pair and self._tools.second is not None:
            families.append(Pairing(scene, self._tools.second))
        return families


def _seen(choice: Choice) -> ScoredCandidate:
    candidate = choice.candidate
    return ScoredCandidate(
        kind=kind_of(candidate.kind),
        node=candidate.motion.node,
        score_m=choice.score_m,
        nodes_world=choice.nodes_world,
        path_world=candidate.motion.waypoints[:, :3].copy(),
    )
