"""The driver of the Franka against franky-sim, a simulator of the arm's protocol: `make test-peers`.

First the requirements on every robot driver, the same functions as in tests/contract, then what only this driver has.
In real time: the simulator has no other, and runs at half its speed on a busy machine.
"""

import asyncio
import logging
import os
import signal
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
import test_robots
from franky_server import FrankyServer, standing_after_s, why_not

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.deadlines import ThreadWatchdog
from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.description.arm.franka import FR3
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import HardwareError, SkillFailure
from dlokit.extras.checks.command import robot_args, run
from dlokit.extras.franka.channel import Channel, path_of
from dlokit.extras.franka.doctor import FirstStart, FrankaDoctorArgs
from dlokit.extras.franka.driver import FrankaRobot, FrankaRobotConfig
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.geometry import downward
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.skills.robot import api as robot_api
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import Lease, RobotMode
from parts.franka_commander import AWAY_RAD, franka
from parts.franka_stops import FAULTS, stopped_after

pytestmark = [pytest.mark.peers, pytest.mark.skipif(bool(why_not()), reason=why_not() or "it can run")]

LEASE = Lease(holder="test", duration_s=0.2)
BAR_BRAKING_S = 0.25
BAR_STANDING_S = 0.3
BAR_LOST_S = 1.5
BRAKING_RAD_S2 = 10.0

# The same tests, on the robot of the fixtures below.
test_a_cancelled_motion_brakes_and_leaves_the_arm_usable = (
    test_robots.test_a_cancelled_motion_brakes_and_leaves_the_arm_usable
)
test_a_motion_is_refused_while_another_runs_or_when_it_starts_elsewhere = (
    test_robots.test_a_motion_is_refused_while_another_runs_or_when_it_starts_elsewhere
)
test_after_a_stop_nothing_moves_until_it_is_enabled_and_recover_does_not_enable_it = (
    test_robots.test_after_a_stop_nothing_moves_until_it_is_enabled_and_recover_does_not_enable_it
)
test_fingers_that_close_stay_where_they_are_when_the_arm_is_stopped = (
    test_robots.test_fingers_that_close_stay_where_they_are_when_the_arm_is_stopped
)
test_halt_ends_a_motion_as_a_named_failure_and_the_next_may_begin = (
    test_robots.test_halt_ends_a_motion_as_a_named_failure_and_the_next_may_begin
)
test_it_knows_its_state_as_soon_as_it_is_connected = test_robots.test_it_knows_its_state_as_soon_as_it_is_connected
test_stop_ends_a_motion_as_a_named_failure = test_robots.test_stop_ends_a_motion_as_a_named_failure


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FrankyServer]:
    with FrankyServer(tmp_path) as server:
        yield server


@asynccontextmanager
async def connected(server: FrankyServer, folder: Path) -> AsyncGenerator[FrankaRobot, None]:
    async with franka(server.address, folder) as robot:
        yield robot


@pytest.fixture(params=["bare", "gated"])
def with_robot(
    request: pytest.FixtureRequest, server: FrankyServer, tmp_path: Path
) -> Callable[[Callable[[Robot], Awaitable[None]]], None]:
    """As in tests/contract, in real time."""

    def run(scenario: Callable[[Robot], Awaitable[None]]) -> None:
        async def main() -> None:
            async with connected(server, tmp_path) as robot:
                gated = GatedRobot(robot, GateConfig(), time.monotonic_ns)
                await scenario(robot if request.param == "bare" else gated)

        asyncio.run(main())

    return run


@pytest.fixture
def with_robot_of_cell(
    with_robot: Callable[[Callable[[Robot], Awaitable[None]]], None],
) -> Callable[[Callable[[Robot], Awaitable[None]]], None]:
    return with_robot


def away(robot: Robot, pace: float = 0.3) -> Awaitable[object]:
    return robot.follow(scaled(joint_move(robot.state().q_rad, AWAY_RAD, FR3.limits), pace), LEASE)


def run_on(server: FrankyServer, folder: Path, scenario: Callable[[FrankaRobot], Awaitable[None]]) -> None:
    async def main() -> None:
        async with connected(server, folder) as robot:
            await scenario(robot)

    asyncio.run(main())


@pytest.mark.parametrize(("pace", "allowed_rad"), [(0.1, 0.015), (0.3, 0.02)])
def test_it_tracks_a_planned_motion(server: FrankyServer, tmp_path: Path, pace: float, allowed_rad: float) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        result = await robot.follow(scaled(joint_move(robot.state().q_rad, AWAY_RAD, FR3.limits), pace), LEASE)
        assert result.largest_joint_error_rad <= allowed_rad
        np.testing.assert_allclose(result.q_rad, AWAY_RAD, atol=allowed_rad)
        np.testing.assert_allclose(server.now().q, result.q_rad, atol=1e-3)

    run_on(server, tmp_path, scenario)


@pytest.mark.parametrize("fault", FAULTS)
def test_the_arm_stands_in_time_whichever_process_fails(fault: str, server: FrankyServer, tmp_path: Path) -> None:
    stopped = stopped_after(fault, server, tmp_path, pace=0.6)
    if fault.startswith(("streaming", "interpreter")):
        assert stopped.standing_s <= BAR_STANDING_S, stopped
    elif fault.startswith("guardian"):  # it takes a second fault at the same time for more than a later brake
        assert stopped.braking_s <= 0.6, stopped
        assert stopped.simulated_s <= 0.6 + stopped.speed_rad_s / BRAKING_RAD_S2 + 0.2, stopped
    else:
        assert stopped.braking_s <= BAR_BRAKING_S, stopped
        # The joints' braking time passes on the simulator's clock, the lease on the machine's.
        assert stopped.simulated_s <= BAR_BRAKING_S + stopped.speed_rad_s / BRAKING_RAD_S2 + 0.2, stopped


def test_a_persons_stop_is_confirmed_within_a_second_and_latched_for_the_next_connection(
    server: FrankyServer, tmp_path: Path
) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(away(robot))
        await asyncio.sleep(0.5)
        began_ns = time.monotonic_ns()
        await robot.stop()
        confirmed_s = (time.monotonic_ns() - began_ns) / 1e9
        with pytest.raises(SkillFailure, match="a person has stopped"):
            await moving
        assert confirmed_s <= 1.0
        assert standing_after_s(server.since(began_ns), began_ns) <= confirmed_s + 0.02

    async def later(robot: FrankaRobot) -> None:
        assert robot.state().stop_latched
        with pytest.raises(SkillFailure, match="a person must enable it"):
            await away(robot)
        await robot.enable()
        await away(robot)

    run_on(server, tmp_path, scenario)
    run_on(server, tmp_path, later)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lost_streaming_process_is_named_and_a_new_connection_moves_on(
    server: FrankyServer, tmp_path: Path, number: signal.Signals
) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(away(robot))
        await asyncio.sleep(0.5)
        began_ns = time.monotonic_ns()
        os.kill(robot.pids["stream"], number)
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert (time.monotonic_ns() - began_ns) / 1e9 <= BAR_LOST_S
        assert failure.value.reason == "robot_lost"
        assert robot.state().mode is RobotMode.FAULT
        with pytest.raises(SkillFailure, match="robot_lost"):
            await away(robot)
        await robot.recover()
        await away(robot)
        np.testing.assert_allclose(robot.state().q_rad, AWAY_RAD, atol=0.02)

    run_on(server, tmp_path, scenario)


def test_a_server_that_is_gone_is_named_and_one_that_is_back_is_used(server: FrankyServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(away(robot))
        await asyncio.sleep(0.5)
        began_ns = time.monotonic_ns()
        server.kill()
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert (time.monotonic_ns() - began_ns) / 1e9 <= BAR_LOST_S
        assert failure.value.reason == "robot_lost"
        with pytest.raises(SkillFailure, match="robot_lost"):
            await robot.recover()
        server.__enter__()
        await robot.recover()
        await away(robot)

    run_on(server, tmp_path, scenario)


def test_a_network_cut_of_more_than_a_second_is_named_and_recovered(server: FrankyServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(away(robot))
        await asyncio.sleep(0.5)
        began_ns = time.monotonic_ns()
        server.freeze()
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert (time.monotonic_ns() - began_ns) / 1e9 <= BAR_LOST_S
        server.thaw()
        assert failure.value.reason == "robot_lost"
        await robot.recover()
        await away(robot)

    run_on(server, tmp_path, scenario)


def test_the_robots_skills_move_grip_and_stop_it(server: FrankyServer, tmp_path: Path) -> None:
    async def main() -> None:
        transport, clock = MemoryTransport(), LoopClock()
        watch = ThreadWatchdog()
        gated = GatedRobot(
            franka(server.address, tmp_path), GateConfig(speed_scale=0.5), time.monotonic_ns, watch=watch
        )
        host = Container(transport, clock)
        host.add(RobotComponent(RobotConfig(), gated, time.monotonic_ns, watch=watch, standing=gated.standing))
        port = Port(transport, clock, InlineCompute(), owner="test", publishes=())
        async with host:
            states = port.stream(topics.ROBOT_STATE)
            await anext(states)
            over_the_table = downward([0.5, 0.1, 0.1], np.pi / 2)
            moved = await port.call(robot_api.MOVE_TO, over_the_table)
            assert isinstance(moved, Succeeded), moved
            low = downward([0.5, 0.1, FR3.gripper.grasp_height_m()], np.pi / 2)
            lowered = await port.call(robot_api.MOVE_LINEAR, low, VelocityProfile())
            assert isinstance(lowered, Succeeded), lowered
            off_m = np.asarray(lowered.result.T_world_tcp.position_m) - low.position_m
            assert np.abs(off_m).max() <= 1e-3
            gripped = await port.call(robot_api.GRASP)
            assert isinstance(gripped, Succeeded), gripped
            assert not gripped.result.held
            homing = asyncio.ensure_future(port.call(robot_api.HOME))
            await asyncio.sleep(0.8)
            stopped = await port.call(robot_api.STOP)
            assert isinstance(stopped, Succeeded), stopped
            ended = await homing
            assert isinstance(ended, Failed), ended
            assert ended.reason == "stopped"
            assert isinstance(await port.call(robot_api.HOME), Rejected)
            assert isinstance(await port.call(robot_api.ENABLE), Succeeded)
            home = await port.call(robot_api.HOME)
            assert isinstance(home, Succeeded), home

    asyncio.run(main())


def test_another_tool_than_the_models_is_refused(tmp_path: Path) -> None:
    with FrankyServer(tmp_path, tool_m=0.12) as server, pytest.raises(HardwareError, match="end effector in Desk"):
        asyncio.run(_open(server, tmp_path))


def test_an_arm_that_does_not_answer_is_named(tmp_path: Path) -> None:
    robot = franka("127.0.31.9", tmp_path)
    with pytest.raises(HardwareError, match="Is the arm on, unlocked, and FCI activated"):
        asyncio.run(_enter(robot))


def test_a_second_driver_is_refused(server: FrankyServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        with pytest.raises(HardwareError, match="another process of this computer"):
            await _enter(franka(server.address, tmp_path))
        await away(robot)

    run_on(server, tmp_path, scenario)


def test_the_thresholds_and_the_load_are_set_read_back_and_recorded_at_each_connection_and_recovery(
    server: FrankyServer, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    config = FrankaRobotConfig(address=server.address, real_time=False, load_kg=0.25)
    caplog.set_level(logging.INFO, "dlokit.extras.franka.driver")

    def logged() -> list[str]:
        return [line for line in caplog.messages if "torque_nm=20.0, force_n=30.0, load_kg=0.25" in line]

    async def main() -> None:
        async with FrankaRobot(config, ArmMount(robot="panda", model=FR3), ThreadPulse(), tmp_path) as robot:
            read_back = "(0.0, 0.0, 103.4) mm from the flange, load of 0.250 kg"
            assert [line.startswith("connected to") and line.endswith(read_back) for line in logged()] == [True]
            first = robot.protection()
            assert first is not None
            assert (first.recovered, first.torque_nm, first.force_n, first.load_kg) == (False, 20.0, 30.0, 0.25)
            assert first.reported_load_kg == pytest.approx(0.25)
            np.testing.assert_allclose(first.T_flange_tool.position_m, [0.0, 0.0, 0.1034], atol=1e-4)
            await robot.stop()
            await robot.enable()
            assert [line.split()[0] for line in logged()] == ["connected", "recovered"]
            assert logged()[-1].endswith(read_back)
            second = robot.protection()
            assert second is not None
            assert second.recovered
            assert second.stamp_ns > first.stamp_ns
            with Channel(path_of(server.address, tmp_path)) as channel:
                state = channel.read_state()
                assert state is not None
                assert state.load_kg == pytest.approx(0.25)

    asyncio.run(main())


def test_the_check_of_robots_passes_it_and_leaves_a_report(
    server: FrankyServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ["--arm", "fr3", "--driver.address", server.address, "--driver.no-real-time", "--operator-confirms"]
    assert run(robot_args(["franka", *options])) == 0
    said = capsys.readouterr().out
    assert "behind the gate: 13 checks passed" in said
    report = Path(said.rpartition("attach to a bug report: ")[2].strip())
    assert "# Check of a robot: passed 13 checks" in report.read_text(encoding="utf-8")


def test_the_first_start_does_each_step_that_a_simulator_can_show(server: FrankyServer, tmp_path: Path) -> None:
    said: list[str] = [""]

    async def ask(question: str) -> bool:
        step = said[-1] if question.startswith("Go on") else question
        return "arm's button" not in step and "that a self-test is due" not in step

    async def main() -> list[DoctorRow]:
        args = FrankaDoctorArgs(driver=FrankaRobotConfig(address=server.address, real_time=False))
        return await FirstStart(args, ask, said.append, franka(server.address, tmp_path)).rows()

    rows = asyncio.run(main())
    assert {row.what for row in rows if row.standing is Severity.SKIPPED} == {
        "real time",
        "camera",
        "calibration",
        "arm's button",
    }
    found = {row.what: row.found for row in rows}
    assert [row.what for row in rows if row.standing is Severity.LACKING] == [], rows
    assert "(0.0, 0.0, 103.4) mm from the flange, load of 0.000 kg" in found["connection"]
    assert "latched until enabled" in found["stop"]
    np.testing.assert_allclose(server.now().q, FR3.home_q_rad, atol=0.01)


def test_fingers_hold_what_stops_them_by_its_width_and_open_again(tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        held = await robot.grip(0.0, 20.0, LEASE)
        assert held.held
        assert held.width_m == pytest.approx(0.03, abs=2e-3)
        assert robot.state().holding
        released = await robot.grip(0.07, 20.0, LEASE)
        assert not released.held
        assert released.width_m == pytest.approx(0.07, abs=1e-3)
        assert not robot.state().holding

    with FrankyServer(tmp_path, obstacle_m=0.03) as server:
        run_on(server, tmp_path, scenario)


def test_the_device_processes_end_with_the_driver(server: FrankyServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        pids.update(robot.pids)

    pids: dict[str, int] = {}
    run_on(server, tmp_path, scenario)
    assert sorted(pids) == ["guardian", "hand", "stream"]
    assert [name for name, pid in pids.items() if Path(f"/proc/{pid}").exists()] == []


async def _open(server: FrankyServer, folder: Path) -> None:
    async with connected(server, folder):
        pass


async def _enter(robot: FrankaRobot) -> None:
    async with robot:
        pass
