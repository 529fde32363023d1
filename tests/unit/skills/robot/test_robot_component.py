"""The robot component over an arm that follows perfectly: one motion at a time, braking, leases, refusals."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

import numpy as np
import pytest

from dlokit.communication import topics, virtual_time
from dlokit.communication.clock import LoopClock
from dlokit.communication.compute import Compute, InlineCompute
from dlokit.communication.host import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.description.panda_data import PANDA_HOME_Q_RAD, PANDA_LIMITS
from dlokit.description.panda_kinematics import tcp_pose
from dlokit.errors import ConfigError
from dlokit.geometry import downward, matrix
from dlokit.skills.robot import api
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.skills.robot.kinematics import PandaKinematics
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.robot import (
    GripResult,
    JointLimits,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotMode,
    RobotState,
)

P = ParamSpec("P")
R = TypeVar("R")


class PerfectArm:
    """Follows to the letter on the loop's clock, and notes what was asked of it."""

    limits: JointLimits = PANDA_LIMITS

    def __init__(self) -> None:
        self.q = PANDA_HOME_Q_RAD.copy()
        self.width_m = 0.08
        self.stops = 0
        self.silent = False
        self.sag_rad = 0.0  # how far the measured angles are from where the arm was told to be
        self.followed: list[JointTrajectory] = []

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stops += 1

    def state(self) -> RobotState:
        return RobotState(
            stamp_ns=0 if self.silent else round(asyncio.get_running_loop().time() * 1e9),
            robot="panda",
            q_rad=self.q + self.sag_rad,
            dq_rad_s=np.zeros(7),
            tau_nm=np.zeros(7),
            T_world_tcp=tcp_pose(self.q),
            finger_width_m=self.width_m,
            mode=RobotMode.IDLE,
        )

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        self.followed.append(trajectory)
        started = asyncio.get_running_loop().time()
        try:
            await asyncio.sleep(float(trajectory.times_s[-1]))
        finally:
            passed = asyncio.get_running_loop().time() - started
            self.q = np.array([np.interp(passed, trajectory.times_s, trajectory.q_rad[:, joint]) for joint in range(7)])
        return MotionResult(q_rad=self.q, T_world_tcp=tcp_pose(self.q), duration_s=passed, largest_joint_error_rad=0.0)

    async def servo(self, targets: AsyncIterator[Pose], lease: Lease) -> MotionResult:
        raise NotImplementedError

    async def grip(self, width_m: float, force_n: float) -> GripResult:
        await asyncio.sleep(0.5)
        self.width_m = width_m
        return GripResult(width_m=width_m, held=False)

    async def stop(self) -> None:
        self.stops += 1

    def brake(self) -> None:
        self.stops += 1

    async def recover(self) -> None:
        self.stops += 1


class Bench:
    """A component on a bus of its own, and a caller."""

    def __init__(self, compute: Compute | None = None) -> None:
        self.arm = PerfectArm()
        self.machine_s = 0.0  # the machine's clock, which stands still unless a test moves it
        transport, clock = MemoryTransport(), LoopClock()
        self.me = transport.identity
        self.host = Host(transport, clock, compute)
        self.host.add(RobotComponent(RobotConfig(), self.arm, lambda: round(self.machine_s * 1e9)))
        self.port = Port(transport, clock, InlineCompute(), owner="test", publishes=())


class SlowCompute:
    """Planning takes a second."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        await asyncio.sleep(1.0)
        return function(*args, **kwargs)


def on_bench(scenario: Callable[[Bench], Awaitable[None]], compute: Compute | None = None) -> None:
    async def main() -> None:
        bench = Bench(compute)
        async with bench.host:
            await scenario(bench)

    virtual_time.run(main())


ABOVE = downward([0.5, 0.1, 0.1], 0.3)
FAR = PANDA_HOME_Q_RAD + np.array([1.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.0])
PROFILE = VelocityProfile()
KINEMATICS = PandaKinematics()


def reason(outcome: Outcome[Any]) -> str:
    assert isinstance(outcome, Failed | Rejected), outcome
    return outcome.reason


def test_it_moves_to_a_pose_carries_and_returns_home() -> None:
    async def scenario(bench: Bench) -> None:
        moved = await bench.port.call(api.MOVE_TO, ABOVE)
        assert isinstance(moved, Succeeded)
        np.testing.assert_allclose(matrix(moved.result.T_world_tcp), matrix(ABOVE), atol=1e-6)
        path = (downward([0.5, 0.1, 0.05], 0.3), downward([0.45, -0.1, 0.05], 0.0))
        carried = await bench.port.call(api.FOLLOW_PATH, path, PROFILE)
        assert isinstance(carried, Succeeded)
        np.testing.assert_allclose(matrix(carried.result.T_world_tcp), matrix(path[-1]), atol=1e-6)
        lowered = await bench.port.call(api.MOVE_LINEAR, downward([0.45, -0.1, 0.011], 0.0), PROFILE)
        assert isinstance(lowered, Succeeded)
        assert isinstance(await bench.port.call(api.HOME), Succeeded)
        np.testing.assert_allclose(bench.arm.q, PANDA_HOME_Q_RAD, atol=1e-9)
        # Each trajectory starts where the one before ended.
        for before, after in zip(bench.arm.followed[:-1], bench.arm.followed[1:], strict=True):
            np.testing.assert_array_equal(before.q_rad[-1], after.q_rad[0])

    on_bench(scenario)


def test_a_trajectory_starts_where_the_last_was_told_to_end_not_where_the_arm_sags_to() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.sag_rad = 0.002
        await bench.port.call(api.MOVE_JOINTS, FAR)
        await bench.port.call(api.HOME)
        np.testing.assert_allclose(bench.arm.followed[1].q_rad[0], FAR, atol=1e-9)
        # Somebody has moved the arm by hand: then only the measured angles are true.
        bench.arm.sag_rad = 0.2
        await bench.port.call(api.HOME)
        np.testing.assert_allclose(bench.arm.followed[2].q_rad[0], PANDA_HOME_Q_RAD + 0.2, atol=1e-9)

    on_bench(scenario)


def test_it_publishes_the_robot_s_state_at_its_rate() -> None:
    async def scenario(bench: Bench) -> None:
        heard = 0
        stream = bench.port.stream(topics.ROBOT_STATE)
        async with asyncio.timeout(10.0):
            async for _ in stream:
                heard += 1
                if heard == 51:
                    break
        assert asyncio.get_running_loop().time() == pytest.approx(1.0, abs=0.021)  # 50 periods of 20 ms

    on_bench(scenario)


def test_an_arm_that_falls_silent_is_not_repeated() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.silent = True
        await asyncio.sleep(0.5)
        assert bench.port.latest(topics.ROBOT_STATE).age_s > 0.4

    on_bench(scenario)


def test_a_motion_that_is_stopped_while_it_is_planned_never_starts() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_LINEAR, KINEMATICS.forward(bench.arm.q), PROFILE))
        await asyncio.sleep(0.5)
        await bench.port.call(api.STOP)
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


def test_stop_brakes_and_the_motion_fails_as_stopped() -> None:
    async def scenario(bench: Bench) -> None:
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        assert isinstance(await bench.port.call(api.STOP), Succeeded)
        assert reason(await moving) == "stopped"
        assert bench.arm.stops == 1
        # The next motion starts where the arm stands, not where it was to end.
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


def test_the_arm_brakes_when_its_commander_s_lease_runs_out() -> None:
    async def scenario(bench: Bench) -> None:
        assert isinstance(await bench.port.call(api.RENEW_LEASE, bench.me, 0.2), Succeeded)
        moving = asyncio.create_task(bench.port.call(api.MOVE_JOINTS, FAR))
        await asyncio.sleep(0.1)
        assert bench.arm.stops == 0
        bench.machine_s = 0.25
        await asyncio.sleep(0.03)  # one look of the watch
        assert bench.arm.stops == 1
        assert reason(await moving) == "lease_lost"
        # An arm that stands is left alone: an order that comes late would stop the next commander's motion.
        await asyncio.sleep(1.0)
        assert bench.arm.stops == 1
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


def test_a_lease_is_one_commander_s_until_it_is_given_back() -> None:
    async def scenario(bench: Bench) -> None:
        await bench.port.call(api.RENEW_LEASE, bench.me, 0.2)
        assert reason(await bench.port.call(api.RENEW_LEASE, "somebody else", 0.2)) == "leased"
        assert reason(await bench.port.call(api.RELEASE_LEASE, "somebody else")) == "leased"
        assert isinstance(await bench.port.call(api.RELEASE_LEASE, bench.me), Succeeded)
        bench.machine_s = 10.0
        assert isinstance(await bench.port.call(api.HOME), Succeeded)

    on_bench(scenario)


def test_a_robot_that_another_commands_refuses_motions_but_not_to_stop() -> None:
    async def scenario(bench: Bench) -> None:
        assert isinstance(await bench.port.call(api.RENEW_LEASE, "the decision process", 0.2), Succeeded)
        for refused in (bench.port.call(api.HOME), bench.port.call(api.RELEASE), bench.port.call(api.RECOVER)):
            assert reason(await refused) == "not_commander"
        assert bench.arm.followed == []
        assert isinstance(await bench.port.call(api.STOP), Succeeded)

    on_bench(scenario)


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        (downward([0.9, 0.0, 0.1], 0.0), "unreachable"),
        (downward([0.5, 0.0, 0.004], 0.0), "table_collision"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_moves(target: Pose, expected: str) -> None:
    async def scenario(bench: Bench) -> None:
        assert reason(await bench.port.call(api.MOVE_TO, target)) == expected
        assert bench.arm.followed == []
        assert isinstance(await bench.port.call(api.MOVE_TO, ABOVE), Succeeded)

    on_bench(scenario)


@pytest.mark.parametrize("q_rad", [np.zeros(6), np.full(7, np.nan)], ids=["six", "nan"])
def test_angles_that_are_none_are_rejected(q_rad: np.ndarray) -> None:
    async def scenario(bench: Bench) -> None:
        assert reason(await bench.port.call(api.MOVE_JOINTS, q_rad)) == "bad_arguments"

    on_bench(scenario)


def test_the_gripper_opens_as_far_as_asked_and_no_further_than_it_can() -> None:
    async def scenario(bench: Bench) -> None:
        opened = await bench.port.call(api.RELEASE, 0.03)
        assert isinstance(opened, Succeeded)
        assert opened.result.width_m == pytest.approx(0.03)
        assert reason(await bench.port.call(api.RELEASE, 0.1)) == "bad_width"
        grasped = await bench.port.call(api.GRASP, 15.0)
        assert isinstance(grasped, Succeeded)
        assert not grasped.result.held

    on_bench(scenario)


@pytest.mark.parametrize("lease_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_lease_that_never_runs_out_or_at_once_is_refused(lease_s: float) -> None:
    with pytest.raises(ConfigError, match="commander-lease-s"):
        RobotConfig(commander_lease_s=lease_s)
