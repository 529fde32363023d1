"""The servo draws the tool to its target within the limits."""

import numpy as np

from dlokit.description.panda_data import PANDA_HOME_Q_RAD, PANDA_LIMITS
from dlokit.description.panda_kinematics import tcp_pose
from dlokit.functional.robots.pose_servo import PoseServo
from dlokit.geometry import compose, downward, matrix, pose

PERIOD_S = 0.02


def test_it_reaches_a_standing_target_within_the_limits() -> None:
    servo = PoseServo(PANDA_HOME_Q_RAD, PANDA_LIMITS, PERIOD_S)
    target = downward([0.45, 0.15, 0.2], 0.4)
    servo.aim(target)
    before = np.zeros(7)
    q = PANDA_HOME_Q_RAD
    for _ in range(200):
        q, dq = servo.step()
        assert np.all(np.abs(dq) <= PANDA_LIMITS.velocity_rad_s + 1e-9)
        assert np.all(np.abs(dq - before) / PERIOD_S <= PANDA_LIMITS.acceleration_rad_s2)
        before = dq
    np.testing.assert_allclose(matrix(tcp_pose(q)), matrix(target), atol=1e-3)


def test_without_a_target_it_stays() -> None:
    q, dq = PoseServo(PANDA_HOME_Q_RAD, PANDA_LIMITS, PERIOD_S).step()
    np.testing.assert_array_equal(q, PANDA_HOME_Q_RAD)
    np.testing.assert_array_equal(dq, 0.0)


def test_a_target_in_the_world_is_meant_for_a_base_elsewhere() -> None:
    T_world_base = pose([0.0, 0.5, 0.0])
    target = downward([0.45, 0.15, 0.2], 0.4)
    here = PoseServo(PANDA_HOME_Q_RAD, PANDA_LIMITS, PERIOD_S)
    there = PoseServo(PANDA_HOME_Q_RAD, PANDA_LIMITS, PERIOD_S, T_world_base)
    here.aim(target)
    there.aim(compose(T_world_base, target))
    np.testing.assert_allclose(here.step()[0], there.step()[0], atol=1e-9)
