"""Which caller may move the arm, and what stops it: stop, cancel, lease, one motion at a time."""

import asyncio

import numpy as np
import pytest
from robot_bench import FAR, KINEMATICS, PROFILE, Bench, SlowCompute, on_bench, reason

from dlokit.communication.timing import virtual_time
from dlokit.errors import ConfigError
from dlokit.skills.robot import api
from dlokit.skills.robot.config import RobotConfig
from dlokit.types.outcome import Cancelled, Failed, Rejected, Succeeded


def test_a_motion_that_is_stopped_while_it_is_planned_never_starts() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_LINEAR, KINEMATICS.forward(bench.arm.q), PROFILE))
        await asyncio.sleep(0.5)
        await bench.port.call(api.HALT)
        assert reason(await moving) == "stopped"
        assert bench.arm.followed == []

    on_bench(scenario, SlowCompute())


def test_a_second_motion_is_rejected_while_one_runs() -> None:
    async def scenario(bench: Bench) -> None:
        first = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        assert reason(await bench.port.call(api.HOME)) == "busy"
        assert reason(await bench.port.call(api.GRASP)) == "busy"
        assert isinstance(await first, Succeeded)
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario)


def test_after_a_stop_every_motion_is_rejected_until_it_is_enabled() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        assert isinstance(await bench.port.call(api.STOP), Succeeded)
        assert reason(await moving) == "stopped"
        followed = len(bench.arm.followed)
        for refused in (
            bench.port.call(api.HOME),
            bench.port.call(api.MOVE_JOINTS, FAR),
            bench.port.call(api.GRASP),
            bench.port.call(api.RELEASE),
            bench.port.call(api.RECOVER),
        ):
            assert reason(await refused) == "stop_latched"
        assert len(bench.arm.followed) == followed
        assert isinstance(await bench.port.call(api.ENABLE), Succeeded)
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario)


def test_a_motion_that_is_being_planned_when_a_person_stops_the_arm_never_starts() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_LINEAR, KINEMATICS.forward(bench.arm.q), PROFILE))
        await asyncio.sleep(0.5)
        assert isinstance(await bench.port.call(api.STOP), Succeeded)
        assert reason(await moving) == "stopped"
        assert bench.arm.followed == []

    on_bench(scenario, SlowCompute())


def test_a_motion_that_a_person_stops_at_a_socket_and_those_after_it_name_the_process_that_stopped_them(
    caplog: pytest.LogCaptureFixture,
) -> None:
    braked = list[int]()

    async def scenario(bench: Bench) -> None:
        def caller() -> str:
            braked.append(bench.arm.stops)
            return "process 4711 (dlokit stop)"

        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        await bench.robot.stop_from_outside(caller)
        outcome = await moving
        assert reason(outcome) == "stopped"
        assert isinstance(outcome, Failed)
        assert outcome.detail.startswith("by process 4711 (dlokit stop): ")
        refused = await bench.port.call(api.HOME)
        for ended in (outcome, refused):
            assert isinstance(ended, Failed | Rejected)
            assert "by process 4711 (dlokit stop)" in ended.detail
        assert isinstance(await bench.port.call(api.ENABLE), Succeeded)
        assert isinstance(await bench.port.call(api.STOP), Succeeded)
        again = await bench.port.call(api.HOME)
        assert isinstance(again, Rejected)
        assert "4711" not in again.detail

    on_bench(scenario)
    assert braked == [1]  # before anything is read of the caller
    assert "the arm was stopped by process 4711 (dlokit stop)" in caplog.text


def test_an_arm_is_stopped_although_the_process_that_stops_it_cannot_be_named() -> None:
    def unnamed() -> str:
        raise OSError("it has gone")

    async def scenario(bench: Bench) -> None:
        with pytest.raises(OSError, match="it has gone"):
            await bench.robot.stop_from_outside(unnamed)
        assert bench.arm.latched
        assert reason(await bench.port.call(api.HOME)) == "stop_latched"

    on_bench(scenario)


def test_a_stop_latched_in_the_arm_by_another_process_is_detected() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.latched = True
        assert reason(await bench.port.call(api.HOME)) == "stop_latched"
        # Taking a lease is allowed: it moves nothing.
        assert isinstance(await bench.port.call(api.RENEW_LEASE, bench.me, 0.2), Succeeded)
        assert reason(await bench.port.call(api.HOME)) == "stop_latched"

    on_bench(scenario)


def test_a_stop_without_confirming_feedback_is_reported() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.silent = True
        assert reason(await bench.port.call(api.STOP)) == "not_confirmed"
        bench.arm.silent = False
        assert reason(await bench.port.call(api.HOME)) == "stop_latched"

    on_bench(scenario)


def test_halt_brakes_and_the_motion_fails_as_stopped() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        assert isinstance(await bench.port.call(api.HALT), Succeeded)
        assert reason(await moving) == "stopped"
        assert bench.arm.stops == 2  # the order at once, and the one that waits until the arm is at rest
        # The next motion starts at the arm's position, not at the previous target.
        assert isinstance(await bench.port.call(api.HOME), Succeeded)
        assert np.abs(bench.arm.followed[-1].q_rad[0] - FAR).max() > 0.1

    on_bench(scenario)


def test_a_cancelled_caller_leaves_the_arm_standing() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        moving.cancel()
        result = (await asyncio.gather(moving, return_exceptions=True))[0]
        assert isinstance(result, asyncio.CancelledError | Cancelled)
        assert bench.arm.stops == 1
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario)


def test_the_arm_brakes_when_its_commanders_lease_expires() -> None:
    async def scenario(bench: Bench) -> None:
        assert isinstance(await bench.port.call(api.RENEW_LEASE, bench.me, 0.2), Succeeded)
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        assert bench.arm.stops == 0
        bench.machine_s = 0.25
        await asyncio.sleep(0.03)  # one period of the watchdog
        assert reason(await moving) == "lease_lost"
        ordered = bench.arm.stops
        assert ordered == 2  # to brake at once, and to report its standstill
        # An arm at rest gets no brake command: a late one would stop the next commander's motion.
        await asyncio.sleep(1.0)
        assert bench.arm.stops == ordered
        assert reason(await bench.port.call(api.HOME)) == "lease_lost"
        await bench.port.call(api.RENEW_LEASE, bench.me, 0.2)
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario)


def test_a_renewed_lease_keeps_the_arm_moving_however_slow_the_cell() -> None:
    async def scenario(bench: Bench) -> None:
        await bench.port.call(api.RENEW_LEASE, bench.me, 0.2)
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        while not moving.done():
            bench.machine_s += 0.15
            await bench.port.call(api.RENEW_LEASE, bench.me, 0.2)
            await asyncio.sleep(0.05)
        assert isinstance(await moving, Succeeded)

    on_bench(scenario)


def test_a_lease_belongs_to_one_commander_until_its_release() -> None:
    async def scenario(bench: Bench) -> None:
        await bench.port.call(api.RENEW_LEASE, bench.me, 0.2)
        bench.transport.identity = "another process"
        assert reason(await bench.port.call(api.RENEW_LEASE, "another process", 0.2)) == "leased"
        assert reason(await bench.port.call(api.RELEASE_LEASE, "another process")) == "leased"
        bench.transport.identity = bench.me
        assert isinstance(await bench.port.call(api.RELEASE_LEASE, bench.me), Succeeded)
        bench.machine_s = 10.0
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario)


def test_a_lease_is_neither_taken_nor_returned_in_the_name_of_another() -> None:
    async def scenario(bench: Bench) -> None:
        assert reason(await bench.port.call(api.RENEW_LEASE, "somebody else", 0.2)) == "not_commander"
        assert isinstance(await bench.port.call(api.RENEW_LEASE, bench.me, 0.2), Succeeded)
        bench.transport.identity = "another process"
        assert reason(await bench.port.call(api.RELEASE_LEASE, bench.me)) == "not_commander"
        assert reason(await bench.port.call(api.HOME)) == "not_commander"

    on_bench(scenario)


def test_a_robot_with_another_commander_refuses_motions_but_not_stops() -> None:
    async def scenario(bench: Bench) -> None:
        bench.transport.identity = "the decision process"
        assert isinstance(await bench.port.call(api.RENEW_LEASE, "the decision process", 0.2), Succeeded)
        bench.transport.identity = bench.me
        for refused in (bench.port.call(api.HOME), bench.port.call(api.RELEASE), bench.port.call(api.RECOVER)):
            assert reason(await refused) == "not_commander"
        assert bench.arm.followed == []
        assert isinstance(await bench.port.call(api.STOP), Succeeded)

    on_bench(scenario)


@pytest.mark.parametrize("lease_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_lease_of_infinite_or_zero_duration_is_refused(lease_s: float) -> None:
    with pytest.raises(ConfigError, match="commander-lease-s"):
        RobotConfig(commander_lease_s=lease_s)


def test_a_motion_before_the_arm_is_connected_fails_by_name() -> None:
    async def main() -> None:
        bench = Bench()
        bench.arm.connected = False
        async with bench.host:
            assert reason(await bench.port.call(api.HOME)) == "robot_lost"

    virtual_time.run(main())
