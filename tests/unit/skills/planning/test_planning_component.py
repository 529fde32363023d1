"""Planning on the bus."""

import pickle
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.scene import NO_FIXTURES, Post, Scene
from dlokit.description.shapes import builtin_shape, moved
from dlokit.geometry import resample
from dlokit.rod import planning_rod
from dlokit.rod.believed import BelievedDlo, as_configured
from dlokit.rod.rollout import settle
from dlokit.skills.planning import api
from dlokit.skills.planning.component import PlanningComponent
from dlokit.skills.planning.config import PlanningConfig, load, strategies, to_spec
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.types.action import Action, Marks
from dlokit.types.dlo import DloState, GoalShape, LogNormal, Topology
from dlokit.types.feasibility import Standing
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.system import StrategySpec

I_SHAPE = builtin_shape("I", 0.5, 31)
TOPOLOGY = Topology(edges=np.zeros((0, 2), dtype=np.int64), rest_lengths_m=np.zeros(0))
SHAPE = DloState(stamp_ns=1, nodes_world=moved(I_SHAPE, (0.0, 0.0), 0.4), topology=TOPOLOGY)
GOAL = GoalShape(stamp_ns=0, nodes_world=I_SHAPE)
NO_MARKS = Marks(invalid_nodes=np.zeros(0, dtype=np.int64))


class Caller(Component):
    """The component that calls."""

    name = "caller"
    reads = (topics.ACTION, topics.GOAL_VERDICT)


def everywhere(T: Pose) -> bool:
    return True


def nowhere(T: Pose) -> bool:
    return False


class Believer(Component):
    """Stands in for the model."""

    name = "model"
    publishes = (topics.BELIEF,)


def with_planning(
    test: Callable[[Port], Awaitable[None]],
    reachable: Callable[[Pose], bool] = everywhere,
    refusal: Callable[[Action], str] | None = None,
    scene: Scene = NO_FIXTURES,
) -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        caller = Caller()
        config = PlanningConfig(strategy=FarthestConfig())
        host.add(PlanningComponent(config, reachable, BelievedDlo(), refusal=refusal, scene=scene))
        host.add(caller)
        async with host:
            await test(caller.port)

    virtual_time.run(main())


def test_a_proposal_is_returned_and_published() -> None:
    async def check(port: Port) -> None:
        outcome = await port.call(api.PROPOSE, SHAPE, GOAL, NO_MARKS)
        assert isinstance(outcome, Succeeded)
        assert outcome.result.grasp.node in (0, 30)
        published = port.latest(topics.ACTION).value
        assert published is not None
        assert published.grasp.node == outcome.result.grasp.node

    with_planning(check)


def test_skipping_gives_the_next_best() -> None:
    async def check(port: Port) -> None:
        nodes: list[int] = []
        for skip in range(3):
            outcome = await port.call(api.PROPOSE, SHAPE, GOAL, NO_MARKS, skip)
            assert isinstance(outcome, Succeeded)
            nodes.append(outcome.result.grasp.node)
        assert sorted(nodes[:2]) == [0, 30]
        assert len(set(nodes)) == 3

    with_planning(check)


def test_no_valid_grasp_is_a_named_failure() -> None:
    async def check(port: Port) -> None:
        outcome = await port.call(api.PROPOSE, SHAPE, GOAL, NO_MARKS)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "no_valid_grasp"

    with_planning(check, nowhere)


def test_an_action_that_the_arms_cannot_execute_is_left_out() -> None:
    async def check(port: Port) -> None:
        first = await port.call(api.PROPOSE, SHAPE, GOAL, NO_MARKS)
        assert isinstance(first, Succeeded)
        assert first.result.grasp.node not in (0, 30)

    with_planning(check, refusal=lambda action: "post A is in the way" if action.grasp.node in (0, 30) else "")


def test_when_the_arms_can_execute_none_it_says_why_after_a_bounded_number_of_checks() -> None:
    asked: list[int] = []

    def all_refused(action: Action) -> str:
        asked.append(action.grasp.node)
        return f"post {len(asked)} is in the way"

    async def check(port: Port) -> None:
        outcome = await port.call(api.PROPOSE, SHAPE, GOAL, NO_MARKS)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "no_valid_grasp"
        assert "post 1 is in the way" in outcome.detail

    with_planning(check, refusal=all_refused)
    assert len(asked) == 12


def test_shapes_of_different_counts_are_rejected() -> None:
    async def check(port: Port) -> None:
        goal = GoalShape(stamp_ns=0, nodes_world=builtin_shape("I", 0.5, 20))
        outcome = await port.call(api.PROPOSE, SHAPE, goal, NO_MARKS)
        assert isinstance(outcome, Rejected)
        assert outcome.reason == "shapes_differ"

    with_planning(check)


def test_verdicts_survive_encoding() -> None:
    async def check(port: Port) -> None:
        off = GoalShape(stamp_ns=0, nodes_world=moved(I_SHAPE, (0.0, 0.4)))
        goal = await port.call(api.JUDGE_GOAL, off, 0.012)
        assert isinstance(goal, Succeeded)
        assert goal.result.standing is Standing.INFEASIBLE
        assert goal.result.reason == "off_table"
        published = port.latest(topics.GOAL_VERDICT).value
        assert published is not None
        assert published.text == goal.result.text
        start = await port.call(api.CHECK_START, SHAPE)
        assert isinstance(start, Succeeded)
        assert start.result.feasible

    with_planning(check)


def test_a_goal_through_a_post_and_an_action_against_one_are_judged_by_the_scene() -> None:
    x, y, _ = (float(each) for each in I_SHAPE[15])
    peg = Post(name="peg", position_m=(x, y, 0.0))

    async def check(port: Port) -> None:
        through = await port.call(api.JUDGE_GOAL, GOAL, 0.012)
        assert isinstance(through, Succeeded)
        assert through.result.reason == "overlaps_fixture"
        outcome = await port.call(api.PROPOSE, SHAPE, GOAL, NO_MARKS)
        assert isinstance(outcome, Succeeded)
        predicted = outcome.result.predicted_nodes_world
        assert predicted is not None
        # The shape turns about the post's place: wherever it ends, it is not through the post.
        apart_m = np.linalg.norm(resample(predicted, 1000)[:, :2] - (x, y), axis=1).min()
        assert apart_m > 0.005 + BelievedDlo().radius_m - 0.001

    with_planning(check, scene=Scene(fixtures=(peg,)))


def test_shapes_that_cannot_be_assessed_are_rejected_with_the_requirement() -> None:
    async def check(port: Port) -> None:
        few = await port.call(api.JUDGE_GOAL, GoalShape(stamp_ns=0, nodes_world=I_SHAPE[:20]), 0.012)
        assert isinstance(few, Rejected)
        assert few.reason == "bad_shape"
        none = await port.call(api.JUDGE_GOAL, GOAL, 0.0)
        assert isinstance(none, Rejected)
        assert none.reason == "bad_threshold"

    with_planning(check)


def test_strategies_are_chosen_by_name() -> None:
    async def check(port: Port) -> None:
        assert isinstance(await port.call(api.SET_STRATEGY, to_spec(FarthestConfig())), Succeeded)
        unknown = await port.call(api.SET_STRATEGY, StrategySpec(name="nearest"))
        assert isinstance(unknown, Rejected)
        assert unknown.reason == "unknown_strategy"
        assert "farthest" in unknown.detail

    assert strategies()["farthest"] is FarthestConfig
    with_planning(check)


def test_code_for_verdicts_is_compiled_for_every_strategy() -> None:
    prepare = PlanningComponent(PlanningConfig(strategy=FarthestConfig()), everywhere, BelievedDlo()).preparation()
    assert prepare is not None
    pickle.loads(pickle.dumps(prepare))()  # it is sent to the worker that computes
    kernel: Any = planning_rod.simulate_motion
    assert len(kernel.signatures) == 1
    settle(BelievedDlo(), GOAL.nodes_world)
    assert len(kernel.signatures) == 1


def test_the_code_of_a_compiled_strategy_is_loaded_before_its_first_call() -> None:
    loaded: list[str] = []

    class Loads(FarthestConfig):
        def load(self) -> None:
            loaded.append("strategy")

    load(Loads())
    assert loaded == ["strategy"]


def test_planning_uses_the_learned_belief() -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        caller, believer = Caller(), Believer()
        for component in (PlanningComponent(PlanningConfig(), everywhere, BelievedDlo()), believer, caller):
            host.add(component)
        tight = GoalShape(stamp_ns=0, nodes_world=builtin_shape("S", 0.5, 31))
        async with host:
            standings: list[Standing] = []
            configured = as_configured(BelievedDlo(), 0)
            stiffer = as_configured(replace(BelievedDlo(), bending_stiffness_n_m2=1e-3), 0)
            stiff = LogNormal(value=stiffer.elastic_m3.value, log_sd=0.1)
            learnt = msgspec.structs.replace(stiffer, elastic_m3=stiff, takes_set=0.0, actions=1)
            for belief in (configured, learnt):
                believer.port.publish(topics.BELIEF, belief)
                await host.clock.sleep(0.01)
                verdict = await caller.port.call(api.JUDGE_GOAL, tight, 0.012)
                assert isinstance(verdict, Succeeded)
                standings.append(verdict.result.standing)
        assert standings == [Standing.HOLDS, Standing.INFEASIBLE]

    virtual_time.run(main())
