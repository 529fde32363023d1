"""The model on the bus: targets in, state out; goals; held nodes follow the tool."""

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
import pytest

from dlokit import geometry
from dlokit.communication import topics, virtual_time
from dlokit.communication.clock import LoopClock
from dlokit.communication.component import Component
from dlokit.communication.host import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.description.shapes import builtin_shape
from dlokit.skills.model import api
from dlokit.skills.model.component import ModelComponent
from dlokit.skills.model.config import ModelConfig
from dlokit.types.action import Grasp, PickPlace, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.flow import GoalFrame, GoalFrames
from dlokit.types.observation import Gripped
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import RobotMode, RobotState

CONFIG = ModelConfig()
I_SHAPE = builtin_shape("I", CONFIG.length_m, CONFIG.nodes)
S_SHAPE = builtin_shape("S", CONFIG.length_m, CONFIG.nodes)


class Others(Component):
    """Everybody that the model listens to, one after the other."""

    name = "others"
    reads = (topics.STATE, topics.GOAL, topics.BELIEF)


def with_model(test: Callable[[Port, MemoryTransport], Awaitable[None]]) -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Host(bus, LoopClock())
        others = Others()
        host.add(ModelComponent(CONFIG))
        host.add(others)
        async with host:
            await test(others.port, bus)

    virtual_time.run(main())


def targets(nodes: Float64Array, stamp_ns: int = 1_000) -> TargetPoints:
    return TargetPoints(stamp_ns=stamp_ns, nodes_world=nodes, visible=np.ones(len(nodes), dtype=np.bool_), health=0.9)


def robot_at(position: Float64Array, stamp_ns: int, holding: bool = True) -> RobotState:
    zeros = np.zeros(7)
    return RobotState(
        stamp_ns=stamp_ns,
        robot="panda",
        q_rad=zeros,
        dq_rad_s=zeros,
        tau_nm=zeros,
        T_world_tcp=geometry.downward(position, np.pi / 2),
        finger_width_m=0.008,
        mode=RobotMode.IDLE,
        holding=holding,
    )


async def state_after_a_moment(port: Port) -> DloState | None:
    await port.clock.sleep(0.01)
    return port.latest(topics.STATE).value


def test_what_is_believed_is_told_again_when_a_goal_is_set_for_those_who_joined_late() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        heard = aiter(port.stream(topics.BELIEF))
        first = await asyncio.wait_for(anext(heard), 1.0)
        await port.call(api.SET_GOAL, I_SHAPE)
        again = await asyncio.wait_for(anext(heard), 1.0)
        assert again.actions == first.actions == 0
        assert again.elastic_m3.value == first.elastic_m3.value

    with_model(check)


def test_what_is_configured_is_told_as_the_first_belief() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        await port.clock.sleep(0.01)
        belief = port.latest(topics.BELIEF).value
        assert belief is not None
        assert belief.actions == 0
        assert belief.bending_stiffness_n_m2.value == CONFIG.bending_stiffness_n_m2
        assert belief.elastic_m3.value == pytest.approx(
            CONFIG.bending_stiffness_n_m2 / (CONFIG.friction * 9.81 * CONFIG.mass_kg_m)
        )
        # A ratio is less sure than any of its parts.
        assert belief.elastic_m3.log_sd > CONFIG.belief.stiffness_log_sd
        low, high = belief.length_m.between()
        assert low < CONFIG.length_m < high

    with_model(check)


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


def test_a_held_node_follows_the_tool_between_two_looks() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        grasp = np.array([*I_SHAPE[28, :2], 0.011])
        bus.publish(topics.ROBOT_STATE, robot_at(grasp, 1_000))
        await port.clock.sleep(0.01)
        bus.publish(topics.GRIPPED, Gripped(stamp_ns=2_000, robot="panda", node=28))
        await port.clock.sleep(0.01)
        for k in range(1, 51):
            bus.publish(topics.ROBOT_STATE, robot_at(grasp + np.array([0.002 * k, 0.0, 0.0]), k * 20_000_000))
            await port.clock.sleep(0.02)
        moved = await state_after_a_moment(port)
        assert moved is not None
        # Tool states come at 50 Hz but are published on at 10: the last may be 0.1 s, 10 mm, old.
        assert moved.nodes_world[28, 0] - I_SHAPE[28, 0] == pytest.approx(0.1, abs=0.012)
        assert moved.observed_stamp_ns == 1_000
        bus.publish(topics.GRIPPED, Gripped(stamp_ns=2_000_000_000, robot="panda", node=None))
        released = await state_after_a_moment(port)
        assert released is not None
        assert released.stamp_ns == 2_000_000_000
        assert released.nodes_world[28, 2] < 0.006

    with_model(check)


@pytest.mark.parametrize(("held", "follows"), [(True, False), (False, True)])
def test_targets_that_no_held_rod_can_have_come_to_are_left_out(held: bool, follows: bool) -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        # The robot's newest state is from before the fingers closed.
        bus.publish(topics.ROBOT_STATE, robot_at(np.array([*I_SHAPE[28, :2], 0.011]), 1_000, holding=False))
        await port.clock.sleep(0.01)
        if held:
            bus.publish(topics.GRIPPED, Gripped(stamp_ns=2_000, robot="panda", node=28))
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
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        grasp = np.array([*I_SHAPE[28, :2], 0.011])
        bus.publish(topics.ROBOT_STATE, robot_at(grasp, 1_000))
        await port.clock.sleep(0.01)
        bus.publish(topics.GRIPPED, Gripped(stamp_ns=2_000, robot="panda", node=28))
        await port.clock.sleep(0.01)
        bus.publish(topics.ROBOT_STATE, robot_at(grasp + np.array([0.1, 0.0, 0.0]), 1_000_000_000, holding=False))
        state = await state_after_a_moment(port)
        assert state is not None
        assert geometry.rmse_m(state.nodes_world, I_SHAPE) < 1e-3

    with_model(check)


def test_a_goal_has_the_models_nodes_whatever_it_was_given() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.SET_GOAL, builtin_shape("S", 0.5, 200), "S", True)
        assert isinstance(outcome, Succeeded)
        assert outcome.result.nodes_world.shape == (CONFIG.nodes, 3)
        assert outcome.result.ends_interchangeable
        published = port.latest(topics.GOAL).value
        assert published is not None
        assert published.name == "S"

    with_model(check)


@pytest.mark.parametrize("bad", [np.zeros((1, 3)), np.zeros((5, 2)), np.full((5, 3), np.nan), np.zeros((5, 3))])
def test_curves_that_are_none_are_rejected(bad: Float64Array) -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.SET_GOAL, bad)
        assert isinstance(outcome, Rejected)
        assert outcome.reason == "bad_shape"

    with_model(check)


def test_frames_drag_the_goal_from_where_the_rod_lies() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        await port.clock.sleep(0.01)
        frames = (GoalFrame(node=15, x_m=0.56, y_m=0.0),)
        for _ in range(5):
            bus.publish(topics.GOAL_FRAMES, GoalFrames(stamp_ns=0, frames=frames))
            await port.clock.sleep(0.01)
        goal = port.latest(topics.GOAL).value
        assert goal is not None
        assert np.hypot(*(goal.nodes_world[15, :2] - (0.56, 0.0))) < 0.004

    with_model(check)


def test_frames_at_the_other_ends_take_the_rod_the_other_way_round() -> None:
    async def scenario(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE[::-1]))
        await state_after_a_moment(port)
        frames = tuple(GoalFrame(node=node, x_m=I_SHAPE[node, 0], y_m=I_SHAPE[node, 1]) for node in (0, 15, 30))
        outcome = await port.call(api.BUILD_GOAL, frames)
        assert isinstance(outcome, Succeeded)
        # The frames lie on the rod: it stays where it is, but for what a damped rod swings by.
        assert geometry.rmse_m(outcome.result.nodes_world, I_SHAPE) < 0.002

    with_model(scenario)


def test_frames_before_any_look_drag_a_straight_rod_in_the_middle_of_the_table() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.BUILD_GOAL, (GoalFrame(node=15, x_m=0.52, y_m=0.0),))
        assert isinstance(outcome, Succeeded)
        # Already there: nothing had to be dragged.
        assert geometry.rmse_m(outcome.result.nodes_world, I_SHAPE) < 1e-3

    with_model(check)


def test_a_frame_on_a_node_that_is_not_there_is_rejected() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.BUILD_GOAL, (GoalFrame(node=99, x_m=0.5, y_m=0.0),))
        assert isinstance(outcome, Rejected)
        assert outcome.reason == "bad_frames"

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


def test_what_an_action_did_is_learnt_from_once() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE))
        await state_after_a_moment(port)
        grasp = np.array([*I_SHAPE[15, :2], 0.011])
        bus.publish(topics.ROBOT_STATE, robot_at(grasp, 0))
        bus.publish(topics.GRIPPED, Gripped(stamp_ns=0, robot="panda", node=15))
        await port.clock.sleep(0.01)
        for step in range(1, 11):
            bus.publish(topics.ROBOT_STATE, robot_at(grasp + np.array([0.005 * step, 0.0, 0.0]), step * 50_000_000))
            await port.clock.sleep(0.01)
        bus.publish(topics.GRIPPED, Gripped(stamp_ns=500_000_000, robot="panda", node=None))
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
