"""Motions that the gate passes to an arm, and those that it refuses by name."""

import asyncio
from collections.abc import Awaitable, Callable

import msgspec
import numpy as np
import pytest
from robot_bench import FAR, KINEMATICS, PerfectArm

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import WORKSPACE, WorkspaceBox
from dlokit.errors import ConfigError, SkillFailure
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.geometry import downward, pose
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.pose import Pose
from dlokit.types.robot import Lease, RobotReason, RobotState

LEASE = Lease(holder="test")
GOOD = joint_move(PANDA.home_q_rad, FAR, PANDA.limits)


class FeltArm(PerfectArm):
    """An arm whose feedback can freeze, shake or be wrong."""

    def __init__(self) -> None:
        super().__init__()
        self.frozen_ns: int | None = None
        self.brakings_s: list[float] = []
        self.dq_rad_s = 0.0

    def state(self) -> RobotState:
        state = super().state()
        newest_ns = state.stamp_ns // 20_000_000 * 20_000_000  # 50 Hz
        stamp_ns = newest_ns if self.frozen_ns is None else self.frozen_ns
        return msgspec.structs.replace(state, stamp_ns=stamp_ns, dq_rad_s=np.full(7, self.dq_rad_s))

    def brake(self) -> None:
        super().brake()
        self.brakings_s.append(asyncio.get_running_loop().time())


def at_gate(
    scenario: Callable[[FeltArm, GatedRobot], Awaitable[None]],
    config: GateConfig | None = None,
    may_move: Callable[[str], bool] = bool,
    T_world_base: Pose | None = None,
    workspace: WorkspaceBox = WORKSPACE,
) -> None:
    async def main() -> None:
        arm = FeltArm()
        robot = GatedRobot(
            arm,
            config or GateConfig(),
            LoopClock().now_ns,
            may_move=may_move,
            T_world_base=T_world_base,
            workspace=workspace,
        )
        await scenario(arm, robot)

    virtual_time.run(main())


async def refusal(motion: Awaitable[object]) -> str:
    with pytest.raises(SkillFailure) as failure:
        await motion
    assert failure.value.detail
    return failure.value.reason


def test_a_planned_motion_passes_unchanged() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        await robot.follow(GOOD, LEASE)
        assert arm.followed == [GOOD]

    at_gate(scenario)


def test_a_motion_that_breaks_a_limit_by_its_differences_is_refused() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        times, nothing = np.array([0.0, 0.005]), np.zeros((2, 7))
        q = PANDA.home_q_rad + np.array([[0.0], [0.08]])
        jump = msgspec.structs.replace(GOOD, times_s=times, q_rad=q, dq_rad_s=nothing, ddq_rad_s2=nothing)
        assert await refusal(robot.follow(jump, LEASE)) == RobotReason.VELOCITY_LIMIT
        spoilt = GOOD.dq_rad_s.copy()
        spoilt[10, 2] = np.nan
        lost = msgspec.structs.replace(GOOD, dq_rad_s=spoilt)
        assert await refusal(robot.follow(lost, LEASE)) == RobotReason.BAD_TRAJECTORY
        assert arm.followed == []

    at_gate(scenario)


def test_every_motion_is_slowed_by_the_speed_scale() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        result = await robot.follow(GOOD, LEASE)
        assert result.duration_s == pytest.approx(10.0 * GOOD.times_s[-1])
        np.testing.assert_allclose(arm.q, FAR, atol=1e-9)

    at_gate(scenario, GateConfig(speed_scale=0.1))


def test_a_motion_that_becomes_too_long_at_a_small_scale_is_refused() -> None:
    path = (downward([0.5, 0.1, 0.1], 0.3), downward([0.5, -0.3, 0.1], 0.3), downward([0.5, 0.3, 0.1], 0.3))
    slow = tool_move(KINEMATICS, KINEMATICS.inverse(path[0]), path[1:], VelocityProfile(speed_m_s=0.08))
    assert 10.0 < slow.times_s[-1] < 20.0

    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        arm.q = slow.q_rad[0]
        assert await refusal(robot.follow(slow, LEASE)) == RobotReason.TOO_SLOW
        assert arm.followed == []

    at_gate(scenario, GateConfig(speed_scale=0.05))


def test_a_motion_too_fast_for_the_limits_passes_when_it_is_scaled_into_them() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        await robot.follow(scaled(GOOD, 1.5), LEASE)

    at_gate(scenario, GateConfig(speed_scale=0.5))


@pytest.mark.parametrize("off_rad", [0.06, -1.0, np.nan])
def test_a_motion_that_does_not_start_at_the_arms_position_is_refused(off_rad: float) -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        arm.sag_rad = off_rad
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.WRONG_START

    at_gate(scenario)


@pytest.mark.parametrize("dq_rad_s", [1.5, np.nan])
def test_a_motion_from_an_arm_that_moves_is_refused(dq_rad_s: float) -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        arm.dq_rad_s = dq_rad_s
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.WRONG_START

    at_gate(scenario)


def test_a_motion_with_frozen_feedback_is_refused_after_a_wait() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        await robot.follow(GOOD, LEASE)
        arm.frozen_ns = 7
        robot.state()
        await asyncio.sleep(0.5)
        loop = asyncio.get_running_loop()
        began = loop.time()
        home = joint_move(FAR, PANDA.home_q_rad, PANDA.limits)
        assert await refusal(robot.follow(home, LEASE)) == RobotReason.STALE_FEEDBACK
        assert loop.time() - began == pytest.approx(1.0, abs=0.05)
        loop.call_later(0.3, setattr, arm, "frozen_ns", None)
        await robot.follow(home, LEASE)
        assert len(arm.followed) == 2

    at_gate(scenario)


def test_a_state_seen_after_a_long_pause_may_be_as_old_as_the_pause() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        robot.state()
        arm.frozen_ns = 7
        await asyncio.sleep(5.0)
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.STALE_FEEDBACK

    at_gate(scenario)


def test_a_motion_is_braked_and_fails_when_feedback_freezes_during_it() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        loop = asyncio.get_running_loop()
        loop.call_at(0.5, setattr, arm, "frozen_ns", 500_000_000)
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.STALE_FEEDBACK
        assert 0.6 < arm.brakings_s[0] <= 0.63
        arm.frozen_ns = None
        ordered = len(arm.brakings_s)
        await robot.follow(joint_move(FAR, PANDA.home_q_rad, PANDA.limits), LEASE)
        assert len(arm.brakings_s) == ordered  # no late command of the previous motion

    at_gate(scenario)


def test_an_arm_whose_clock_does_not_advance_is_not_braked() -> None:
    class DrawnArm(FeltArm):
        """An arm whose state and clock do not advance, as while the cell renders."""

        def now_ns(self) -> int:
            return super().now_ns() if self.frozen_ns is None else self.frozen_ns

    async def main() -> None:
        loop, arm = asyncio.get_running_loop(), DrawnArm()
        robot = GatedRobot(arm, GateConfig(), LoopClock().now_ns)
        loop.call_at(0.5, setattr, arm, "frozen_ns", 500_000_000)
        await robot.follow(GOOD, LEASE)
        assert arm.brakings_s == []

    virtual_time.run(main())


def test_an_arm_that_has_just_connected_moves_at_once() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        async with robot:
            result = await robot.follow(GOOD, LEASE)
        assert asyncio.get_running_loop().time() == result.duration_s

    at_gate(scenario)


def test_a_motion_waits_for_an_arm_that_comes_to_rest() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        arm.dq_rad_s = 1.5
        asyncio.get_running_loop().call_later(0.2, setattr, arm, "dq_rad_s", 0.01)
        await robot.follow(GOOD, LEASE)

    at_gate(scenario)


def test_there_is_no_wait_while_states_arrive() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        for _ in range(5):
            robot.state()
            await asyncio.sleep(0.02)
        loop = asyncio.get_running_loop()
        began = loop.time()
        await robot.follow(GOOD, LEASE)
        assert loop.time() - began == pytest.approx(GOOD.times_s[-1], abs=1e-9)

    at_gate(scenario)


def test_the_tool_stays_inside_its_box_for_any_mounting_pose() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.OUTSIDE_WORKSPACE
        assert arm.followed == []

    box = WorkspaceBox(lower_m=(0.2, -0.2, 0.3), upper_m=(0.6, 0.2, 0.6))
    at_gate(scenario, workspace=box)  # the tool is at y = 0.24 m
    at_gate(scenario, T_world_base=pose([0.0, 0.0, -0.5]))


def test_a_tool_faster_than_allowed_is_refused() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.TOOL_SPEED

    at_gate(scenario, GateConfig(largest_tool_speed_m_s=0.3))


@pytest.mark.parametrize("duration_s", [np.inf, np.nan, 0.0, -1.0])
def test_a_lease_without_an_end_is_refused(duration_s: float) -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        assert await refusal(robot.follow(GOOD, Lease(holder="test", duration_s=duration_s))) == RobotReason.LEASE_LOST

    at_gate(scenario)


def test_only_the_holder_of_the_lease_moves_the_arm() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        assert await refusal(robot.follow(GOOD, LEASE)) == RobotReason.LEASE_LOST
        await robot.follow(GOOD, Lease(holder="another"))

    at_gate(scenario, may_move=lambda holder: holder == "another")


@pytest.mark.parametrize("width_m", [-0.01, 0.081, np.nan, np.inf])
def test_a_width_outside_the_hands_range_is_refused(width_m: float) -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        assert await refusal(robot.grip(width_m, 20.0, LEASE)) == "bad_width"
        assert arm.width_m == 0.08

    at_gate(scenario)


@pytest.mark.parametrize("force_n", [0.0, -5.0, 71.0, np.nan, np.inf])
def test_a_force_outside_the_hands_range_is_refused(force_n: float) -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        assert await refusal(robot.grip(0.0, force_n, LEASE)) == "bad_force"

    at_gate(scenario)


def test_stop_brake_and_recover_always_pass() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        arm.frozen_ns = 1
        await robot.stop()
        robot.brake()
        await robot.recover()
        assert arm.stops == 3

    at_gate(scenario, may_move=lambda _: False)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"speed_scale": 0.04}, "speed-scale"),
        ({"speed_scale": 1.1}, "speed-scale"),
        ({"speed_scale": np.nan}, "speed-scale"),
        ({"largest_tool_speed_m_s": 0.0}, "largest-tool-speed-m-s"),
    ],
)
def test_invalid_settings_are_refused(settings: dict[str, float], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        GateConfig(**settings)  # type: ignore[arg-type]  # the point of the test


@pytest.mark.parametrize("corner", [{"lower_m": (0.0, 0.0, 2.0)}, {"upper_m": (1.0, np.nan, 1.0)}])
def test_a_box_without_inside_is_refused(corner: dict[str, tuple[float, float, float]]) -> None:
    with pytest.raises(ConfigError, match="workspace"):
        WorkspaceBox(**corner)


def test_the_box_contains_home_the_work_area_and_lifts_to_half_a_metre() -> None:
    async def scenario(arm: FeltArm, robot: GatedRobot) -> None:
        for x, y in ((0.4, -0.4), (0.6, 0.25), (0.5, 0.0)):
            low, high = downward([x, y, 0.011], 0.0), downward([x, y, 0.5], 0.0)
            q = KINEMATICS.inverse(low)
            for move in (
                joint_move(arm.q, q, PANDA.limits),
                tool_move(KINEMATICS, q, (high,), VelocityProfile(speed_m_s=1.0)),
            ):
                await robot.follow(move, LEASE)
            await robot.follow(joint_move(arm.q, PANDA.home_q_rad, PANDA.limits), LEASE)

    at_gate(scenario)
