"""The model component's belief about the DLO: publication, prediction and learning."""

import asyncio

import numpy as np
import pytest
from model_bench import CONFIG, I_SHAPE, S_SHAPE, robot_at, state_after_a_moment, targets, with_model

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.skills.model import api
from dlokit.types.action import Grasp, PickPlace, VelocityProfile
from dlokit.types.observation import GraspState
from dlokit.types.outcome import Failed, Rejected, Succeeded


def test_the_belief_is_published_again_with_each_goal_for_late_readers() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        heard = aiter(port.stream(topics.BELIEF))
        first = await asyncio.wait_for(anext(heard), 1.0)
        await port.call(api.SET_GOAL, I_SHAPE)
        again = await asyncio.wait_for(anext(heard), 1.0)
        assert again.actions == first.actions == 0
        assert again.elastic_m3.value == first.elastic_m3.value

    with_model(check)


def test_the_configured_belief_is_published_first() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        await port.clock.sleep(0.01)
        belief = port.latest(topics.BELIEF).value
        assert belief is not None
        assert belief.actions == 0
        assert belief.bending_stiffness_n_m2.value == CONFIG.bending_stiffness_n_m2
        assert belief.elastic_m3.value == pytest.approx(
            CONFIG.bending_stiffness_n_m2 / (CONFIG.friction * 9.81 * CONFIG.mass_kg_m)
        )
        # A ratio is more uncertain than any of its factors.
        assert belief.elastic_m3.log_sd > CONFIG.belief.stiffness_log_sd
        low, high = belief.length_m.interval()
        assert low < CONFIG.length_m < high

    with_model(check)


def test_predict_and_settle_answer_with_shapes() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        state = await state_after_a_moment(port)
        assert state is not None
        start = np.array([*I_SHAPE[28, :2], 0.011])
        action = PickPlace(
            stamp_ns=0,
            grasp=Grasp(node=28, T_world_tcp=geometry.downward(start, np.pi / 2)),
            path=(geometry.downward(start + np.array([0.05, 0.0, 0.0]), np.pi / 2),),
            velocity=VelocityProfile(),
        )
        predicted = await port.call(api.PREDICT, action, state)
        assert isinstance(predicted, Succeeded)
        assert predicted.result.nodes_world[28, 0] > I_SHAPE[28, 0] + 0.03
        settled = await port.call(api.SETTLE, S_SHAPE)
        assert isinstance(settled, Succeeded)
        assert settled.result.shape == (CONFIG.nodes, 3)

    with_model(check)


def test_each_action_is_learned_from_once() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        await state_after_a_moment(port)
        grasp = np.array([*I_SHAPE[15, :2], 0.011])
        bus.publish(topics.ROBOT_STATE, robot_at(grasp, 0))
        bus.publish(topics.GRIPPED, GraspState(stamp_ns=0, robot="first", node=15))
        await port.clock.sleep(0.01)
        for step in range(1, 11):
            bus.publish(topics.ROBOT_STATE, robot_at(grasp + np.array([0.005 * step, 0.0, 0.0]), step * 50_000_000))
            await port.clock.sleep(0.01)
        bus.publish(topics.GRIPPED, GraspState(stamp_ns=500_000_000, robot="first", node=None))
        await port.clock.sleep(0.01)
        after = I_SHAPE + np.array([0.05, 0.0, 0.0]) * np.exp(-(((np.arange(31) - 15) / 8.0) ** 2))[:, None]
        learnt = await port.call(api.LEARN, I_SHAPE, after)
        assert isinstance(learnt, Succeeded)
        belief = port.latest(topics.BELIEF).value
        assert belief is not None
        assert belief.actions == learnt.result.actions == 1
        again = await port.call(api.LEARN, I_SHAPE, after)
        assert isinstance(again, Failed)
        assert again.reason == "nothing_held"
        bad = await port.call(api.LEARN, I_SHAPE[:5], after)
        assert isinstance(bad, Rejected)
        assert bad.reason == "bad_shape"

    with_model(check)
