"""Requirements on every robot driver. A new driver is one more row in `ROBOTS`."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, ParamSpec

import numpy as np
import pytest
from cell_bench import CellBench

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.pulse import Pulse, loop_pulse
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.errors import HardwareError, SkillFailure
from dlokit.functional.cell import api as cell_api
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.functional.robots.kinematic import KinematicRobot
from dlokit.functional.robots.simulated import SimulatedRobot
from dlokit.geometry import downward, matrix
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import START_RAD, scaled
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.robot import Lease, RobotMode

P = ParamSpec("P")

KINEMATICS = ArmKinematics(PANDA)
LEASE = Lease(holder="test", duration_s=0.2)
ROD_Y_M = np.linspace(-0.25, 0.25, 41)
ROD = np.column_stack([np.full(41, 0.5), ROD_Y_M])
SETTLED = CellConfig(settle_s=0.2)
AWAY = KINEMATICS.inverse(downward([0.45, 0.2, 0.15], 0.4))


@asynccontextmanager
async def simulated() -> AsyncGenerator[Robot, None]:
    """The Panda of a cell whose rope lies along y at x = 0.5 m."""
    async with of_cell() as robot, robot:
        yield robot


@asynccontextmanager
async def of_cell(pulse: Pulse = loop_pulse) -> AsyncGenerator[Robot, None]:
    """The same, not connected yet."""
    bench = CellBench(ROD, SETTLED)
    async with bench.host:
        yield SimulatedRobot(bench.port("driver"), pulse=pulse)


@asynccontextmanager
async def gated() -> AsyncGenerator[Robot, None]:
    """The same behind the gate."""
    async with simulated() as robot:
        yield GatedRobot(robot, GateConfig(), LoopClock().now_ns)


@asynccontextmanager
async def kinematic() -> AsyncGenerator[Robot, None]:
    """A Panda in software."""
    async with KinematicRobot(LoopClock(), FIRST_ALONE[0]) as robot:
        yield robot


@asynccontextmanager
async def rehearsing() -> AsyncGenerator[Robot, None]:
    """A Panda in software that begins where the one of the cell is, behind the gate."""
    async with of_cell() as device, KinematicRobot(LoopClock(), FIRST_ALONE[0], device) as robot:
        yield GatedRobot(robot, GateConfig(), LoopClock().now_ns)


IN_CELL: dict[str, Callable[[], AbstractAsyncContextManager[Robot]]] = {"simulated": simulated, "gated": gated}
IN_SOFTWARE: dict[str, Callable[[], AbstractAsyncContextManager[Robot]]] = {
    "kinematic": kinematic,
    "rehearsing": rehearsing,
}
"""Arms without mass, whose fingers close on nothing."""
ROBOTS = IN_CELL | IN_SOFTWARE


@pytest.fixture(params=ROBOTS)
def with_robot(request: pytest.FixtureRequest) -> Callable[[Callable[[Robot], Awaitable[None]]], None]:
    """Runs a scenario on one of the robots, on virtual time."""

    def run(scenario: Callable[[Robot], Awaitable[None]]) -> None:
        async def main() -> None:
            async with ROBOTS[request.param]() as robot:
                await scenario(robot)

        virtual_time.run(main())

    return run


@pytest.fixture(params=IN_CELL)
def with_robot_of_cell(request: pytest.FixtureRequest) -> Callable[[Callable[[Robot], Awaitable[None]]], None]:
    """The same for an arm that has mass, and a rope within reach."""

    def run(scenario: Callable[[Robot], Awaitable[None]]) -> None:
        async def main() -> None:
            async with ROBOTS[request.param]() as robot:
                await scenario(robot)

        virtual_time.run(main())

    return run


WithRobot = Callable[[Callable[[Robot], Awaitable[None]]], None]


def test_it_knows_its_state_as_soon_as_it_is_connected(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        state = robot.state()
        assert state.mode is RobotMode.IDLE
        np.testing.assert_allclose(state.q_rad, PANDA.home_q_rad, atol=1e-3)
        np.testing.assert_allclose(matrix(state.T_world_tcp), matrix(KINEMATICS.forward(state.q_rad)), atol=1e-3)
        assert np.all(robot.arm.limits.position_lower_rad < robot.arm.limits.position_upper_rad)

    with_robot(scenario)


def test_it_follows_a_trajectory_closely_and_reports_the_error(with_robot_of_cell: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        trajectory = joint_move(PANDA.home_q_rad, AWAY, PANDA.limits)
        result = await robot.follow(trajectory, LEASE)
        np.testing.assert_allclose(result.q_rad, AWAY, atol=2e-3)  # still oscillating by about a millimetre
        # Accelerating at the limit of 7.5 rad/s² bends the position controller by about 5 mrad.
        assert 0.0 < result.largest_joint_error_rad < 0.02
        assert result.duration_s == pytest.approx(trajectory.times_s[-1], abs=0.05)

    with_robot_of_cell(scenario)


def test_a_cancelled_motion_brakes_and_leaves_the_arm_usable(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        moving = asyncio.create_task(robot.follow(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), LEASE))
        await asyncio.sleep(0.3)
        moving.cancel()
        await asyncio.gather(moving, return_exceptions=True)
        await robot.halt()
        await asyncio.sleep(0.2)
        state = robot.state()
        assert state.mode is RobotMode.IDLE
        assert np.max(np.abs(state.dq_rad_s)) < 0.01
        assert np.max(np.abs(state.q_rad - AWAY)) > 0.1
        await robot.follow(joint_move(state.q_rad, PANDA.home_q_rad, PANDA.limits), LEASE)

    with_robot(scenario)


def test_halt_ends_a_motion_as_a_named_failure_and_the_next_may_begin(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        moving = asyncio.create_task(robot.follow(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), LEASE))
        await asyncio.sleep(0.3)
        await robot.halt()
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert failure.value.reason == "stopped"
        await robot.follow(joint_move(robot.state().q_rad, PANDA.home_q_rad, PANDA.limits), LEASE)

    with_robot(scenario)


def test_after_a_stop_nothing_moves_until_it_is_enabled_and_recover_does_not_enable_it(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        await robot.stop()
        await asyncio.sleep(0.1)
        assert robot.state().stop_latched
        await robot.recover()
        stands, width_m = robot.state().q_rad, robot.state().finger_width_m
        for motion in (robot.follow(joint_move(stands, AWAY, PANDA.limits), LEASE), robot.grip(0.02, 20.0, LEASE)):
            with pytest.raises(SkillFailure) as failure:
                await motion
            assert failure.value.reason == "stop_latched"
        await asyncio.sleep(0.3)
        np.testing.assert_allclose(robot.state().q_rad, stands, atol=1e-3)
        assert robot.state().finger_width_m == pytest.approx(width_m, abs=1e-4)
        await robot.enable()
        await robot.follow(joint_move(stands, AWAY, PANDA.limits), LEASE)
        assert not robot.state().stop_latched

    with_robot(scenario)


def test_fingers_that_close_stay_where_they_are_when_the_arm_is_stopped(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        closing = asyncio.create_task(robot.grip(0.0, 20.0, LEASE))
        await asyncio.sleep(0.2)
        await robot.stop()
        with pytest.raises(SkillFailure) as failure:
            await closing
        assert failure.value.reason == "stopped"
        await asyncio.sleep(0.1)
        stopped_m = robot.state().finger_width_m
        assert 0.02 < stopped_m < 0.078
        await asyncio.sleep(1.0)
        assert robot.state().finger_width_m == pytest.approx(stopped_m, abs=1e-3)

    with_robot(scenario)


def test_stop_ends_a_motion_as_a_named_failure(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        moving = asyncio.create_task(robot.follow(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), LEASE))
        await asyncio.sleep(0.3)
        await robot.stop()
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert failure.value.reason == "stopped"

    with_robot(scenario)


def test_a_motion_is_refused_while_another_runs_or_when_it_starts_elsewhere(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        with pytest.raises(SkillFailure) as failure:
            await robot.follow(joint_move(AWAY, PANDA.home_q_rad, PANDA.limits), LEASE)
        assert failure.value.reason == "wrong_start"
        # So slow that the arm is still where the second one starts, else that would be the reason.
        trajectory = scaled(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), 0.2)
        moving = asyncio.create_task(robot.follow(trajectory, LEASE))
        await asyncio.sleep(0.1)
        with pytest.raises(SkillFailure) as failure:
            await robot.follow(trajectory, LEASE)
        assert failure.value.reason == "busy"
        await moving

    with_robot(scenario)


def test_a_motion_may_start_as_far_off_as_those_who_plan_it_are_told(with_robot: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        start = PANDA.home_q_rad + 0.95 * START_RAD
        await robot.follow(joint_move(start, start + 0.01, PANDA.limits), LEASE)

    with_robot(scenario)


def test_it_grips_lifts_and_releases_a_rope_and_detects_an_empty_grip(with_robot_of_cell: WithRobot) -> None:
    async def scenario(robot: Robot) -> None:
        empty = await robot.grip(0.0, 20.0, LEASE)
        assert not empty.held
        await robot.grip(0.04, 20.0, LEASE)
        assert robot.state().finger_width_m == pytest.approx(0.04, abs=1e-3)
        above = KINEMATICS.inverse(downward([0.5, 0.1, 0.1], np.pi / 2))
        await robot.follow(joint_move(PANDA.home_q_rad, above, PANDA.limits), LEASE)
        down = tool_move(KINEMATICS, above, (downward([0.5, 0.1, 0.011], np.pi / 2),), VelocityProfile())
        await robot.follow(down, LEASE)
        gripped = await robot.grip(0.0, 20.0, LEASE)
        assert gripped.held
        assert gripped.width_m == pytest.approx(0.008, abs=1.5e-3)  # the rope is 8 mm thick and slightly compressible
        path = (downward([0.5, 0.1, 0.06], np.pi / 2), downward([0.45, 0.15, 0.06], np.pi / 2))
        carry = tool_move(KINEMATICS, down.q_rad[-1], path, VelocityProfile())
        await robot.follow(carry, LEASE)
        await asyncio.sleep(0.1)
        assert robot.state().holding
        released = await robot.grip(0.04, 20.0, LEASE)
        assert not released.held
        assert not robot.state().holding

    with_robot_of_cell(scenario)


def silent(port: Port) -> Port:
    """The port of a driver that has died: it sends no heartbeats."""
    send = port.send

    def send_others(skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        if skill.key != cell_api.RENEW.key:
            send(skill, *args, **kwargs)

    port.send = send_others
    return port


def test_the_arm_brakes_when_its_driver_dies_and_moves_again_once_recovered() -> None:
    async def main() -> None:
        bench = CellBench(ROD, SETTLED)
        async with bench.host, SimulatedRobot(silent(bench.port("driver"))) as robot:
            with pytest.raises(SkillFailure) as failure:
                await robot.follow(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), LEASE)
            assert failure.value.reason == "lost_commander"
            await asyncio.sleep(0.1)
            assert robot.state().mode is RobotMode.FAULT
            await robot.recover()
            await asyncio.sleep(0.1)
            assert robot.state().mode is RobotMode.IDLE
            with pytest.raises(SkillFailure) as failure:
                await robot.grip(0.0, 20.0, LEASE)
            assert failure.value.reason == "lost_commander"
            assert robot.state().finger_width_m > 0.02

    virtual_time.run(main())


def test_an_arm_in_software_follows_exactly_and_its_device_does_not_move() -> None:
    async def main() -> None:
        async with of_cell() as device, KinematicRobot(LoopClock(), FIRST_ALONE[0], device) as robot:
            before = device.state()
            result = await robot.follow(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), LEASE)
            np.testing.assert_allclose(result.q_rad, AWAY, atol=1e-12)  # but for rounding in the sum of its steps
            assert not (await robot.grip(0.0, 20.0, LEASE)).held
            np.testing.assert_allclose(device.state().q_rad, before.q_rad, atol=1e-4)
            assert device.state().finger_width_m == pytest.approx(before.finger_width_m, abs=1e-4)
            await robot.stop()
            await asyncio.sleep(0.1)
            assert device.state().stop_latched
            await robot.enable()
            await asyncio.sleep(0.1)
            assert not device.state().stop_latched

    virtual_time.run(main())


def test_an_arm_in_software_brakes_at_an_order_from_another_thread() -> None:
    async def main() -> None:
        async with kinematic() as robot:
            robot.brake()  # at rest: without effect
            slow = scaled(joint_move(PANDA.home_q_rad, AWAY, PANDA.limits), 0.01)  # not over before the order
            moving = asyncio.create_task(robot.follow(slow, LEASE))
            await asyncio.sleep(0.3)
            await asyncio.to_thread(robot.brake)
            with pytest.raises(SkillFailure, match="braked"):
                await moving
            assert np.max(np.abs(robot.state().q_rad - AWAY)) > 0.1

    asyncio.run(main())


def test_a_driver_without_a_cell_reports_it() -> None:
    async def main() -> None:
        port = Port(MemoryTransport(), LoopClock(), InlineCompute(), owner="driver", publishes=())
        with pytest.raises(HardwareError, match="is the cell running"):
            async with SimulatedRobot(port):
                pass

    virtual_time.run(main())
