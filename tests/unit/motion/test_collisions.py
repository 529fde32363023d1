"""Every reason to refuse a trajectory, and valid trajectories that pass."""

import msgspec
import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.errors import SkillFailure
from dlokit.geometry import downward, pose
from dlokit.motion.collisions import check_collisions, segment_distances
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import check_limits
from dlokit.motion.planned_motion import planned
from dlokit.motion.trajectories import joint_move
from dlokit.types.robot import JointTrajectory, RobotReason

KINEMATICS = ArmKinematics(PANDA)
GOOD = joint_move(PANDA.home_q_rad, KINEMATICS.inverse(downward([0.5, 0.1, 0.1], 0.0)), PANDA.limits)


def reason_of(trajectory: JointTrajectory) -> str:
    with pytest.raises(SkillFailure) as failure:
        planned(KINEMATICS, lambda: trajectory)
    return failure.value.reason


def test_a_planned_trajectory_passes() -> None:
    assert planned(KINEMATICS, lambda: GOOD) is GOOD


def test_a_joint_outside_its_range_is_named() -> None:
    q = GOOD.q_rad.copy()
    q[10, 3] = 0.0
    assert reason_of(msgspec.structs.replace(GOOD, q_rad=q)) == RobotReason.JOINT_LIMIT


def test_running_a_trajectory_faster_breaks_velocity_then_acceleration_then_jerk_limits() -> None:
    def at_pace(pace: float) -> JointTrajectory:
        return JointTrajectory(
            times_s=GOOD.times_s / pace,
            q_rad=GOOD.q_rad,
            dq_rad_s=GOOD.dq_rad_s * pace,
            ddq_rad_s2=GOOD.ddq_rad_s2 * pace**2,
        )

    assert reason_of(at_pace(1.2)) == RobotReason.VELOCITY_LIMIT
    slow = msgspec.structs.replace(at_pace(1.2), dq_rad_s=GOOD.dq_rad_s)
    assert reason_of(slow) == RobotReason.ACCELERATION_LIMIT


def test_a_jump_in_acceleration_is_named() -> None:
    ddq = np.zeros_like(GOOD.ddq_rad_s2)
    ddq[len(ddq) // 2, 1] = 0.9 * PANDA.limits.acceleration_rad_s2[1]
    times = np.linspace(0.0, 0.1, len(ddq))  # so that the step between samples requires more than 3750 rad/s³
    assert reason_of(msgspec.structs.replace(GOOD, times_s=times, ddq_rad_s2=ddq)) == RobotReason.JERK_LIMIT


@pytest.mark.parametrize("times", [[0.0, 0.0], [0.1, 0.2], [0.2, 0.1]])
def test_times_that_do_not_rise_from_zero_are_refused(times: list[float]) -> None:
    two = JointTrajectory(
        times_s=np.array(times), q_rad=np.zeros((2, 7)), dq_rad_s=np.zeros((2, 7)), ddq_rad_s2=np.zeros((2, 7))
    )
    with pytest.raises(SkillFailure) as failure:
        check_limits(two, PANDA.limits)
    assert failure.value.reason == RobotReason.BAD_TRAJECTORY


def test_the_arm_may_approach_the_table_but_not_touch_it() -> None:
    check_collisions(PANDA, KINEMATICS.inverse(downward([0.5, 0.0, 0.011], 0.0))[None])
    with pytest.raises(SkillFailure, match="raise the path") as failure:
        check_collisions(PANDA, KINEMATICS.inverse(downward([0.5, 0.0, 0.005], 0.0))[None])
    assert failure.value.reason == RobotReason.TABLE_COLLISION


def test_the_table_is_the_world_s_not_the_base_s() -> None:
    q = KINEMATICS.inverse(downward([0.5, 0.0, 0.011], 0.0))[None]
    check_collisions(PANDA, q, T_world_base=pose([0.0, 0.0, 0.02]))
    with pytest.raises(SkillFailure):
        check_collisions(PANDA, q, T_world_base=pose([0.0, 0.0, -0.02]))


def test_a_gripper_folded_into_the_shoulder_is_a_self_collision() -> None:
    with pytest.raises(SkillFailure) as failure:
        check_collisions(PANDA, np.array([[0.0, -0.5, 0.0, -3.0, 0.0, 0.3, 0.0]]))
    assert failure.value.reason == RobotReason.SELF_COLLISION


def test_a_collision_in_the_middle_of_a_move_is_found() -> None:
    # Both ends are clear, the straight line in joint space between them is not.
    near, far = (KINEMATICS.inverse(downward([x, 0.0, 0.011], 0.0)) for x in (0.30, 0.75))
    check_collisions(PANDA, np.array([near, far]))
    assert reason_of(joint_move(near, far, PANDA.limits)) == RobotReason.TABLE_COLLISION


def test_segment_distances_agree_with_a_dense_search() -> None:
    rng = np.random.default_rng(0)
    ends = rng.normal(size=(4, 50, 3))
    found = segment_distances(*ends)
    share = np.linspace(0.0, 1.0, 401)[:, None]
    for i in range(50):
        first = ends[0, i] + share * (ends[1, i] - ends[0, i])
        second = ends[2, i] + share * (ends[3, i] - ends[2, i])
        searched = np.linalg.norm(first[:, None] - second[None], axis=-1).min()
        assert found[i] <= searched + 1e-12
        # Half a step of the search on segments up to 6 long, both ways; larger where segments nearly cross.
        assert searched - found[i] < 0.015
