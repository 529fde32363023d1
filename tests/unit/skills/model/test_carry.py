"""The rod between two observations: it follows the tools that hold it."""

import numpy as np
import pytest
from model_bench import CONFIG, I_SHAPE, robot_at
from msgspec.structs import replace

from dlokit import geometry
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.skills.model.carry import Carry
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

PERIOD_NS = 20_000_000
GRASP_M = np.array([0.0, 0.0, 0.007])  # of the tool above the node


def tool_of(robot: str, position: Float64Array, stamp_ns: int) -> RobotState:
    return replace(robot_at(position, stamp_ns), robot=robot)


def lifted(step: int) -> Float64Array:
    """Tool position after this number of periods of 20 ms: 4 cm up, 10 cm across, 4 cm down, half a second each."""
    legs = np.array([[0.0, 0.0, 0.04], [0.1, 0.0, 0.0], [0.0, 0.0, -0.04]])
    done = np.clip(step / 25.0 - np.arange(3), 0.0, 1.0)
    return np.asarray(done @ legs, dtype=np.float64)


def carried(start: Float64Array, node: int) -> Carry:
    carry = Carry(CONFIG)
    carry.place(start)
    grasp = start[node] + GRASP_M
    carry.take_hold("panda", node, tool_of("panda", grasp, 0))
    for step in range(1, 76):
        assert carry.move(tool_of("panda", grasp + lifted(step), step * PERIOD_NS))
    return carry


def test_a_released_rod_has_the_predicted_shape_of_the_same_motion() -> None:
    carry = carried(I_SHAPE, 28)
    assert carry.travelled_m == pytest.approx(0.18)
    assert carry.release("panda")
    grasp = I_SHAPE[28] + GRASP_M
    track = np.array([[*(grasp + lifted(step)), np.pi / 2] for step in range(1, 76)])
    motion = Motion(node=28, waypoints=track[:1], velocity=VelocityProfile(), track=track)
    predicted = simulate(CONFIG, I_SHAPE, (PlanningRod(),), (motion,), PERIOD_NS / 1e9).nodes_world[0, 0]
    # The time steps differ.
    assert geometry.rmse_m(carry.nodes_world, predicted) < 0.002
    assert geometry.rmse_m(predicted, I_SHAPE) > 0.01


def test_rounding_errors_do_not_grow() -> None:
    rng = np.random.default_rng(0)
    start = I_SHAPE * (1.0 + 1e-12 * rng.uniform(-1.0, 1.0, I_SHAPE.shape))
    # With contacts that appear and break, as in MuJoCo, this would grow to centimetres; here it stays small.
    assert np.abs(carried(I_SHAPE, 20).nodes_world - carried(start, 20).nodes_world).max() < 1e-9


@pytest.mark.parametrize("node", [2, 15])
@pytest.mark.parametrize("heading_rad", np.linspace(0.0, 2.0 * np.pi, 6)[:-1])
def test_the_rod_stays_with_a_tool_that_moved_on_while_its_states_were_lost(node: int, heading_rad: float) -> None:
    carry = Carry(CONFIG)
    carry.place(I_SHAPE)
    grasp = I_SHAPE[node] + GRASP_M
    carry.take_hold("panda", node, tool_of("panda", grasp, 0))
    away = 0.4 * np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    assert carry.move(tool_of("panda", grasp + away, 10 * PERIOD_NS))
    assert carry.release("panda")
    # No part of a rod is farther from where it was held than the rod is long.
    assert np.linalg.norm(carry.nodes_world - grasp - away, axis=1).max() < CONFIG.length_m


def test_two_tools_lift_a_rod_that_falls_after_the_last_release() -> None:
    carry = Carry(CONFIG)
    carry.place(I_SHAPE)
    ends = {"left": 2, "right": 28}
    for robot, node in ends.items():
        carry.take_hold(robot, node, tool_of(robot, I_SHAPE[node] + GRASP_M, 0))
    up = np.array([0.0, 0.0, 0.05])
    for step in range(1, 26):
        for robot, node in ends.items():
            carry.move(tool_of(robot, I_SHAPE[node] + GRASP_M + step / 25.0 * up, step * PERIOD_NS))
    nodes = carry.nodes_world
    # The second tool is one report ahead of the rod.
    assert nodes[[2, 28], 2] == pytest.approx(I_SHAPE[[2, 28], 2] + 0.05, abs=0.004)
    assert nodes[15, 2] < 0.035  # it hangs between them
    assert not carry.release("left")
    assert carry.holds
    assert carry.release("right")
    assert carry.nodes_world[:, 2].max() < 0.01


@pytest.mark.parametrize("stamp_ns", [0, -PERIOD_NS])
def test_a_report_that_is_not_newer_moves_nothing(stamp_ns: int) -> None:
    carry = Carry(CONFIG)
    carry.place(I_SHAPE)
    carry.take_hold("panda", 15, tool_of("panda", I_SHAPE[15] + GRASP_M, 0))
    before = carry.nodes_world
    assert not carry.move(tool_of("panda", I_SHAPE[15] + 0.1, stamp_ns))
    assert np.array_equal(carry.nodes_world, before)


def test_a_pin_is_at_the_present_tool_position() -> None:
    carry = Carry(CONFIG)
    carry.place(I_SHAPE)
    grasp = I_SHAPE[15] + GRASP_M
    carry.take_hold("panda", 15, tool_of("panda", grasp, 0))
    by = np.array([0.1, 0.02, 0.03])
    away = tool_of("panda", grasp + by, PERIOD_NS)
    (pin,) = carry.pins({"panda": away})
    assert pin.node == 15
    assert pin.position_world == pytest.approx(I_SHAPE[15] + by, abs=1e-9)
