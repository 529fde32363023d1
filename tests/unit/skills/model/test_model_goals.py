"""The goal of the model component: curves, and frames that an operator drags."""

import numpy as np
import pytest
from model_bench import CONFIG, I_SHAPE, state_after_a_moment, targets, with_model

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.shapes import builtin_shape
from dlokit.skills.model import api
from dlokit.skills.model.component import ModelComponent
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import GoalFrame, GoalFrames
from dlokit.types.outcome import Rejected, Succeeded
from dlokit.types.passing import SideWish


def test_a_goal_has_the_models_number_of_nodes() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.SET_GOAL, builtin_shape("S", 0.5, 200), "S", True)
        assert isinstance(outcome, Succeeded)
        assert outcome.result.nodes_world.shape == (CONFIG.nodes, 3)
        assert outcome.result.ends_interchangeable
        published = port.latest(topics.GOAL).value
        assert published is not None
        assert published.name == "S"

    with_model(check)


def test_a_goal_carries_its_own_wish_on_posts_or_that_of_the_run() -> None:
    run, own = (SideWish(name="A", turn=1),), (SideWish(name="B", turn=-1),)

    async def check() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        host.add(ModelComponent(CONFIG, FRANKA_HAND, beside=run))
        async with host:
            for wish, published in ((None, run), (own, own), ((), ())):
                outcome = await bus.call(api.SET_GOAL, I_SHAPE, "I", False, wish)
                assert isinstance(outcome, Succeeded)
                assert outcome.result.beside == published
            dragged = await bus.call(api.BUILD_GOAL, (GoalFrame(node=0, x_m=0.5, y_m=-0.2),))
            assert isinstance(dragged, Succeeded)
            assert dragged.result.beside == run

    virtual_time.run(check())


@pytest.mark.parametrize("bad", [np.zeros((1, 3)), np.zeros((5, 2)), np.full((5, 3), np.nan), np.zeros((5, 3))])
def test_invalid_curves_are_rejected(bad: Float64Array) -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.SET_GOAL, bad)
        assert isinstance(outcome, Rejected)
        assert outcome.reason == "bad_shape"

    with_model(check)


def test_frames_drag_the_goal_from_the_rods_shape() -> None:
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


def test_frames_at_exchanged_ends_reverse_the_rod() -> None:
    async def scenario(port: Port, bus: MemoryTransport) -> None:
        bus.publish(topics.TARGETS, targets(I_SHAPE[::-1]))
        await state_after_a_moment(port)
        frames = tuple(GoalFrame(node=node, x_m=I_SHAPE[node, 0], y_m=I_SHAPE[node, 1]) for node in (0, 15, 30))
        outcome = await port.call(api.BUILD_GOAL, frames)
        assert isinstance(outcome, Succeeded)
        # The frames are on the rod: it stays in place except for damped oscillation.
        assert geometry.rmse_m(outcome.result.nodes_world, I_SHAPE) < 0.002

    with_model(scenario)


def test_frames_before_any_observation_drag_a_straight_rod_in_the_middle_of_the_table() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.BUILD_GOAL, (GoalFrame(node=15, x_m=0.52, y_m=0.0),))
        assert isinstance(outcome, Succeeded)
        # Already there: nothing had to be dragged.
        assert geometry.rmse_m(outcome.result.nodes_world, I_SHAPE) < 1e-3

    with_model(check)


def test_a_frame_on_a_missing_node_is_rejected() -> None:
    async def check(port: Port, bus: MemoryTransport) -> None:
        outcome = await port.call(api.BUILD_GOAL, (GoalFrame(node=99, x_m=0.5, y_m=0.0),))
        assert isinstance(outcome, Rejected)
        assert outcome.reason == "bad_frames"

    with_model(check)
