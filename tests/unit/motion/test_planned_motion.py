"""Joint moves that fixtures block go over them; what is too high for that is refused by its name."""

import numpy as np
import pytest

from dlokit.description.arm.franka import FR3, PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.scene import Box, Fixture, Post
from dlokit.errors import SkillFailure
from dlokit.geometry import downward
from dlokit.motion.fixture_clearance import FIXTURE_CLEARANCE_M, arm_solids, fixture_solids, gaps_m
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import check_limits
from dlokit.motion.planned_motion import planned
from dlokit.motion.trajectories import backwards, joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.robot import JointTrajectory, RobotReason

KINEMATICS = ArmKinematics(PANDA)
WALL = tuple(Post(name=f"post{i}", position_m=(0.4 + 0.03 * i, 0.0, 0.0)) for i in range(6))


def across(arm: ArmModel, height_m: float = 0.03) -> JointTrajectory:
    """A joint move of the tool from one side of the wall to the other."""
    kinematics = ArmKinematics(arm)
    start, end = (kinematics.inverse(downward((0.5, y, height_m), 0.2)) for y in (-0.15, 0.15))
    return joint_move(start, end, arm.limits)


def least_gap_m(arm: ArmModel, motion: JointTrajectory, fixtures: tuple[Fixture, ...]) -> float:
    return float(gaps_m(arm_solids(arm, motion.q_rad, 0.02), fixture_solids(fixtures)).min())


def test_a_clear_motion_stays_as_it_is_planned() -> None:
    direct = across(PANDA, height_m=0.1)
    assert planned(KINEMATICS, lambda: direct, WALL, 0.02, over=True) is direct


@pytest.mark.parametrize("arm", [PANDA, FR3])
def test_a_blocked_joint_move_goes_over_to_its_target(arm: ArmModel) -> None:
    direct = across(arm)
    assert least_gap_m(arm, direct, WALL) < 0.0
    motion = planned(ArmKinematics(arm), lambda: direct, WALL, 0.02, over=True)
    check_limits(motion, arm.limits)
    assert least_gap_m(arm, motion, WALL) >= FIXTURE_CLEARANCE_M
    np.testing.assert_allclose(motion.q_rad[[0, -1]], direct.q_rad[[0, -1]], atol=1e-9)
    tools = np.array([ArmKinematics(arm).forward(q).position_m for q in motion.q_rad])
    low = tools[:, 2] < 0.035
    sides = tools[low, :2] - np.where(tools[low, 1:2] < 0.0, (0.5, -0.15), (0.5, 0.15))
    assert np.abs(sides).max() < 1e-3  # straight up and down


def test_a_motion_along_a_path_of_its_own_is_refused_and_not_led_over() -> None:
    with pytest.raises(SkillFailure, match="the fixture post") as failure:
        planned(KINEMATICS, lambda: across(PANDA), WALL, 0.02)
    assert failure.value.reason == RobotReason.FIXTURE_COLLISION


def test_a_fixture_too_high_to_go_over_is_named() -> None:
    tower = (*WALL, Box(name="tower", position_m=(0.55, 0.0, 0.0), size_m=(0.4, 0.04, 0.9)))[5:]
    with pytest.raises(SkillFailure, match=r"the fixture tower.*cannot go over it either") as failure:
        planned(KINEMATICS, lambda: across(PANDA), tower, 0.02, over=True)
    assert failure.value.reason == RobotReason.FIXTURE_COLLISION


def test_a_tower_that_is_not_in_the_way_does_not_raise_the_way_over() -> None:
    aside = (*WALL, Box(name="tower", position_m=(0.3, 0.45, 0.0), size_m=(0.04, 0.04, 0.9)))
    motion = planned(KINEMATICS, lambda: across(PANDA), aside, 0.02, over=True)
    assert max(KINEMATICS.forward(q).position_m[2] for q in motion.q_rad) < 0.2


def test_a_start_above_the_fixtures_only_goes_down_at_the_target() -> None:
    start, end = (KINEMATICS.inverse(downward((0.5, y, z), 0.0)) for y, z in ((-0.2, 0.12), (0.06, 0.02)))
    near = (Box(name="rim", position_m=(0.5, 0.005, 0.0), size_m=(0.1, 0.01, 0.04)),)
    direct = joint_move(start, end, PANDA.limits)
    assert least_gap_m(PANDA, direct, near) < FIXTURE_CLEARANCE_M
    motion = planned(KINEMATICS, lambda: direct, near, 0.02, over=True)
    heights = np.array([KINEMATICS.forward(q).position_m[2] for q in motion.q_rad])
    assert heights[: len(heights) // 2].max() <= heights[0] + 0.001
    np.testing.assert_allclose(motion.q_rad[-1], end, atol=1e-9)


def test_a_move_backwards_keeps_limits_that_depend_on_the_direction() -> None:
    start = ArmKinematics(FR3).inverse(downward((0.35, 0.0, 0.03), 0.2))
    up = tool_move(ArmKinematics(FR3), start, (downward((0.35, 0.0, 0.25), 0.2),), VelocityProfile())
    back = backwards(up, FR3.limits)
    check_limits(back, FR3.limits)
    np.testing.assert_array_equal(back.q_rad, up.q_rad[::-1])
    assert backwards(joint_move(start, start, FR3.limits), FR3.limits).q_rad.shape == (2, 7)
