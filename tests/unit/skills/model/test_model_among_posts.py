"""The model among posts: no carried rod and no goal under frames goes through one; a seen rod is where it is seen."""

import numpy as np
from model_bench import CONFIG, I_SHAPE, Others, robot_at, state_after_a_moment, targets

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.installation import Installation
from dlokit.description.scene import Post, Scene
from dlokit.rod.believed import topology
from dlokit.skills.model.api import PREDICT, SETTLE
from dlokit.skills.model.carry import Carry
from dlokit.skills.model.component import ModelComponent
from dlokit.skills.model.goal import GoalRod
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.types.action import Drag, Grasp, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.flow import GoalFrame
from dlokit.types.outcome import Succeeded
from dlokit.types.robot import FIRST_ROBOT

BESIDE_M = 0.02
SCENE = Scene(fixtures=(Post(name="peg", position_m=(float(I_SHAPE[15, 0]) + BESIDE_M, float(I_SHAPE[15, 1]), 0.0)),))
POSTS = SCENE.posts_world
REACH_M = 0.005 + CONFIG.radius_m
SOFT_M = 1e-3


def clearance_m(nodes_world: Float64Array) -> float:
    points = geometry.resample(nodes_world, 1000)[:, :2]
    return float(np.linalg.norm(points - POSTS[0, :2], axis=1).min())


def dragged_end() -> list[Float64Array]:
    """Places of a tool at the last node that drags it past the post, every 20 ms."""
    steps = np.linspace(0.0, 1.0, 60)[1:, None]
    return list(I_SHAPE[30] + np.array([0.0, 0.0, 0.007]) + steps * np.array([0.15, -0.05, 0.0]))


def test_a_carried_rod_lies_around_a_post() -> None:
    carry = Carry(CONFIG, POSTS)
    carry.place(I_SHAPE)
    carry.take_hold(FIRST_ROBOT, 30, robot_at(I_SHAPE[30] + np.array([0.0, 0.0, 0.007]), 0))
    for step, place in enumerate(dragged_end(), start=1):
        carry.move(robot_at(place, step * 20_000_000))
    held = clearance_m(carry.nodes_world)
    assert carry.release(FIRST_ROBOT)
    assert held > REACH_M - SOFT_M
    assert clearance_m(carry.nodes_world) > REACH_M - SOFT_M
    assert carry.nodes_world[15, 0] < POSTS[0, 0] < carry.nodes_world[30, 0]


def test_a_rod_that_was_predicted_on_the_wrong_side_of_a_post_is_tracked_to_where_it_is_seen() -> None:
    seen = I_SHAPE + np.array([2.0 * BESIDE_M, 0.0, 0.0])

    async def tracked() -> DloState:
        bus = MemoryTransport()
        host, others = Container(bus, LoopClock()), Others()
        host.add(ModelComponent(CONFIG, FRANKA_HAND, SCENE))
        host.add(others)
        async with host:
            for nodes in (I_SHAPE, seen):
                bus.publish(topics.TARGETS, targets(nodes))
                state = await state_after_a_moment(others.port)
        assert state is not None
        return state

    assert np.abs(virtual_time.run(tracked()).nodes_world - seen).max() < SOFT_M


def test_frames_do_not_pull_a_goal_through_a_post() -> None:
    goal = GoalRod(CONFIG, POSTS)
    goal.place(I_SHAPE)
    x, y = POSTS[0, 0] + 0.08, I_SHAPE[15, 1]
    frames = tuple(GoalFrame(node=n, x_m=x, y_m=y + aside_m) for n, aside_m in ((0, -0.2), (30, 0.2)))
    for _ in range(10):
        goal.drag(frames)
    nodes = goal.nodes_world
    assert clearance_m(nodes) > REACH_M - SOFT_M
    assert nodes[15, 0] < POSTS[0, 0]


class Asking(Component):
    """A component that calls others."""

    name = "asking"


def test_predictions_of_a_run_know_the_posts_of_its_scene() -> None:
    here, there = I_SHAPE[30] + np.array([0.0, 0.0, 0.007]), dragged_end()[-1]
    drag = Drag(
        stamp_ns=0,
        grasp=Grasp(node=30, T_world_tcp=geometry.downward(here, np.pi / 2)),
        path=(geometry.downward(there, np.pi / 2),),
        velocity=VelocityProfile(),
    )
    state = DloState(stamp_ns=0, nodes_world=I_SHAPE, topology=topology(CONFIG))
    config = RunConfig(installation=Installation(fixtures=SCENE.fixtures))

    async def asked() -> tuple[Float64Array, Float64Array]:
        host, asking = Container(MemoryTransport(), LoopClock()), Asking()
        host.add(build_component("model", config, Wiring()))
        host.add(asking)
        async with host:
            predicted = await asking.port.call(PREDICT, drag, state)
            settled = await asking.port.call(SETTLE, I_SHAPE + np.array([BESIDE_M - 0.004, 0.0, 0.0]))
        assert isinstance(predicted, Succeeded)
        assert isinstance(settled, Succeeded)
        return predicted.result.nodes_world, settled.result

    for nodes in virtual_time.run(asked()):
        assert clearance_m(nodes) > REACH_M - SOFT_M
