"""Motions of the robot component, and those that it refuses."""

import asyncio

import msgspec
import numpy as np
import pytest
from made_results import PROTECTED
from robot_bench import ABOVE, FAR, PROFILE, Bench, on_bench, reason

from dlokit.communication import topics
from dlokit.description.arm.franka import PANDA
from dlokit.geometry import downward, matrix
from dlokit.skills.robot import api
from dlokit.types.outcome import Succeeded
from dlokit.types.pose import Pose


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
        np.testing.assert_allclose(bench.arm.q, PANDA.home_q_rad, atol=1e-9)
        # Each trajectory starts where the one before ended.
        for before, after in zip(bench.arm.followed[:-1], bench.arm.followed[1:], strict=True):
            np.testing.assert_array_equal(before.q_rad[-1], after.q_rad[0])

    on_bench(scenario)


def test_a_trajectory_starts_at_the_last_commanded_position_not_at_the_sagging_one() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.sag_rad = 0.002
        await bench.port.call(api.MOVE_JOINTS, FAR)
        await bench.port.call(api.HOME)
        np.testing.assert_allclose(bench.arm.followed[1].q_rad[0], FAR, atol=1e-9)
        # The arm was moved by hand: only the measured angles are true.
        bench.arm.sag_rad = 0.2
        await bench.port.call(api.HOME)
        np.testing.assert_allclose(bench.arm.followed[2].q_rad[0], PANDA.home_q_rad + 0.2, atol=1e-9)

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


def test_what_is_set_on_the_arm_is_published_once_each_time_it_is_set() -> None:
    async def scenario(bench: Bench) -> None:
        stream = bench.port.stream(topics.PROTECTION)
        await asyncio.sleep(0.5)
        bench.arm.protected = PROTECTED
        await asyncio.sleep(0.5)
        bench.arm.protected = msgspec.structs.replace(PROTECTED, stamp_ns=PROTECTED.stamp_ns + 1, recovered=True)
        set_last = [await anext(stream), await anext(stream)]
        assert [one.stamp_ns - PROTECTED.stamp_ns for one in set_last] == [0, 1]
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.5):
                await anext(stream)

    on_bench(scenario)


def test_the_last_state_of_a_silent_arm_is_not_published_again() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.silent = True
        await asyncio.sleep(0.5)
        assert bench.port.latest(topics.ROBOT_STATE).age_s > 0.4

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


@pytest.mark.parametrize(
    ("q_rad", "expected"), [(np.zeros(6), "bad_trajectory"), (np.full(7, np.nan), "bad_arguments")], ids=["six", "nan"]
)
def test_invalid_angles_are_refused(q_rad: np.ndarray, expected: str) -> None:
    async def scenario(bench: Bench) -> None:
        assert reason(await bench.port.call(api.MOVE_JOINTS, q_rad)) == expected

    on_bench(scenario)


def test_the_gripper_opens_to_the_requested_width_within_its_range() -> None:
    async def scenario(bench: Bench) -> None:
        opened = await bench.port.call(api.RELEASE, 0.03)
        assert isinstance(opened, Succeeded)
        assert opened.result.width_m == pytest.approx(0.03)
        assert reason(await bench.port.call(api.RELEASE, 0.1)) == "bad_width"
        grasped = await bench.port.call(api.GRASP, 15.0)
        assert isinstance(grasped, Succeeded)
        assert not grasped.result.held

    on_bench(scenario)


def test_after_braking_for_old_feedback_a_motion_starts_at_fresh_feedback() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.frozen = bench.arm.state()
        bench.arm.q = bench.arm.q + 0.3  # its position at standstill, of which no feedback arrived
        await asyncio.sleep(0.5)
        going_home = asyncio.create_task(bench.port.call(api.HOME))
        await asyncio.sleep(0.5)
        assert bench.arm.followed == []
        stood = bench.arm.q
        bench.arm.frozen = None
        assert isinstance(await going_home, Succeeded)
        (motion,) = bench.arm.followed
        np.testing.assert_array_equal(motion.q_rad[0], stood)

    on_bench(scenario)


def test_no_motion_is_planned_without_feedback() -> None:
    async def scenario(bench: Bench) -> None:
        bench.arm.frozen = bench.arm.state()
        await asyncio.sleep(0.5)
        for call in (bench.port.call(api.HOME), bench.port.call(api.MOVE_LINEAR, ABOVE, PROFILE)):
            assert reason(await call) == "stale_feedback"
        assert bench.arm.followed == []

    on_bench(scenario)
