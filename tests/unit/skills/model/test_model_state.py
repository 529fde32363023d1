"""The state of the model component: target points and the holding arm pull it."""

import numpy as np
import pytest
from model_bench import I_SHAPE, S_SHAPE, robot_at, state_after_a_moment, targets, with_model

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.description.shapes import builtin_shape
from dlokit.skills.model import api
from dlokit.types.arrays import Float64Array
from dlokit.types.observation import GraspState
from dlokit.types.outcome import Succeeded


async def _grasped(port: Port, bus: MemoryTransport) -> Float64Array:
    """The tool's position (3,) [m] where it has gripped node 28 of a straight rod."""
    bus.publish(topics.TARGETS, targets(I_SHAPE))
    grasp = np.array([*I_SHAPE[28, :2], 0.011])
    bus.publish(topics.ROBOT_STATE, robot_at(grasp, 1_000))
    await port.clock.sleep(0.01)
    bus.publish(topics.GRIPPED, GraspState(stamp_ns=2_000, robot="first", node=28))
    await port.clock.sleep(0.01)
    return grasp


def test_the_first_targets_become_the_state_and_later_ones_drag_it() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        for stamp_ns, shape in ((1_000, I_SHAPE), (2_000, S_SHAPE)):
            bus.publish(topics.TARGETS, targets(shape, stamp_ns))
            state = await state_after_a_moment(port)
            assert state is not None
            assert geometry.rmse_m(state.nodes_world, shape) < 1e-3
            assert state.stamp_ns == state.observed_stamp_ns == stamp_ns
            assert state.health == 0.9
            assert state.visible is not None

    with_model(check)


def test_targets_of_another_count_are_refused_and_the_next_are_taken() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(builtin_shape("I", 0.5, 20)))
        assert await state_after_a_moment(port) is None
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        assert await state_after_a_moment(port) is not None

    with_model(check)


def test_reset_with_nodes_publishes_them_as_the_state() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        assert isinstance(await port.call(api.RESET, S_SHAPE), Succeeded)
        state = await state_after_a_moment(port)
        assert state is not None
        assert geometry.rmse_m(state.nodes_world, S_SHAPE) < 1e-3
        assert state.visible is None
        assert state.observed_stamp_ns == 0

    with_model(check)


def test_a_held_node_follows_the_tool_between_two_observations() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        grasp = await _grasped(port, bus)
        for k in range(1, 51):
            bus.publish(topics.ROBOT_STATE, robot_at(grasp + np.array([0.002 * k, 0.0, 0.0]), k * 20_000_000))
            await port.clock.sleep(0.02)
        moved = await state_after_a_moment(port)
        assert moved is not None
        # Tool states arrive at 50 Hz, states are published at 10 Hz: the last may be 0.1 s (10 mm) old.
        assert moved.nodes_world[28, 0] - I_SHAPE[28, 0] == pytest.approx(0.1, abs=0.012)
        assert moved.observed_stamp_ns == 1_000
        bus.publish(topics.GRIPPED, GraspState(stamp_ns=2_000_000_000, robot="first", node=None))
        released = await state_after_a_moment(port)
        assert released is not None
        assert released.stamp_ns == 2_000_000_000
        assert released.nodes_world[28, 2] < 0.006

    with_model(check)


@pytest.mark.parametrize(("held", "follows"), [(True, False), (False, True)])
def test_targets_that_a_held_rod_cannot_have_reached_are_ignored(held: bool, follows: bool) -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        # The robot's newest state is from before the fingers closed.
        bus.publish(topics.ROBOT_STATE, robot_at(np.array([*I_SHAPE[28, :2], 0.011]), 1_000, holding=False))
        await port.clock.sleep(0.01)
        if held:
            bus.publish(topics.GRIPPED, GraspState(stamp_ns=2_000, robot="first", node=28))
        await port.clock.sleep(0.01)
        far = I_SHAPE + np.array([0.1, 0.0, 0.0])
        bus.publish(topics.TARGETS, targets(far, 3_000))
        state = await state_after_a_moment(port)
        assert state is not None
        assert state.observed_stamp_ns == 3_000
        wanted = far if follows else I_SHAPE
        assert geometry.rmse_m(state.nodes_world, wanted) < 1e-3

    with_model(check)


def test_a_tool_that_lost_its_grip_does_not_move_the_model() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        grasp = await _grasped(port, bus)
        bus.publish(topics.ROBOT_STATE, robot_at(grasp + np.array([0.1, 0.0, 0.0]), 1_000_000_000, holding=False))
        state = await state_after_a_moment(port)
        assert state is not None
        assert geometry.rmse_m(state.nodes_world, I_SHAPE) < 1e-3

    with_model(check)
