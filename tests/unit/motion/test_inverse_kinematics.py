"""Inverse kinematics: solutions have the requested pose, within the limits, over the whole table."""

import pickle
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import arm_model
from dlokit.errors import SkillFailure
from dlokit.geometry import compose, downward, matrix, pose
from dlokit.motion.collisions import check_collisions
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.tool_path import half_turned, points_down
from dlokit.types.pose import Pose

KINEMATICS = ArmKinematics(PANDA)


def tilted(T: Pose, tilt_rad: tuple[float, float]) -> Pose:
    return compose(T, pose([0, 0, 0], Rotation.from_rotvec([*tilt_rad, 0.0]).as_quat(scalar_first=True)))


def random_grasps(count: int) -> list[Pose]:
    rng = np.random.default_rng(3)
    places = rng.uniform([0.32, -0.33], [0.70, 0.33], (count, 2))
    return [downward([x, y, rng.uniform(0.011, 0.3)], rng.uniform(-np.pi, np.pi)) for x, y in places]


def inside_limits(q: np.ndarray) -> bool:
    return bool(np.all(q >= PANDA.limits.position_lower_rad) and np.all(q <= PANDA.limits.position_upper_rad))


def test_a_downward_pose_is_reached_exactly_or_turned_by_half_a_turn() -> None:
    for T in random_grasps(50):
        q = KINEMATICS.inverse(T, yaw=Yaw.EITHER)
        assert inside_limits(q)
        reached = matrix(KINEMATICS.forward(q))
        # A closed solution: nothing but rounding.
        assert min(np.abs(reached - matrix(meant)).max() for meant in (T, half_turned(T))) < 1e-9


def test_the_pose_as_given_is_preferred() -> None:
    T = downward([0.5, 0.1, 0.1], 0.7)
    reached = KINEMATICS.forward(KINEMATICS.inverse(T, yaw=Yaw.EITHER))
    np.testing.assert_allclose(matrix(reached), matrix(T), atol=1e-9)


def test_a_yaw_outside_joint_7_is_reached_from_the_other_side_or_refused() -> None:
    # Joint 7 is at pi/4 - yaw here; its limit is 166°.
    T = downward([0.5, 0.0, 0.1], np.pi / 4 + np.radians(175.0))
    with pytest.raises(SkillFailure, match="that way round"):
        KINEMATICS.inverse(T, yaw=Yaw.EXACT)
    reached = KINEMATICS.forward(KINEMATICS.inverse(T, yaw=Yaw.EITHER))
    np.testing.assert_allclose(matrix(reached), matrix(half_turned(T)), atol=1e-9)


def test_a_tilted_pose_is_solved_by_differential_kinematics() -> None:
    rng = np.random.default_rng(5)
    for T in random_grasps(20):
        target = tilted(T, (rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4)))
        assert not points_down(target)
        q = KINEMATICS.inverse(target, PANDA.home_q_rad, Yaw.EITHER)
        assert inside_limits(q)
        reached = matrix(KINEMATICS.forward(q))
        # The solver's own tolerances: 1e-5 m and 1e-4 rad.
        assert min(np.abs(reached - matrix(meant)).max() for meant in (target, half_turned(target))) < 2e-4


def test_the_gripper_reaches_the_whole_table_except_the_far_corners(capsys: pytest.CaptureFixture[str]) -> None:
    reached, asked = 0, 0
    for x in np.linspace(0.30, 0.75, 10):
        for y in np.linspace(-0.35, 0.35, 15):
            for yaw in np.linspace(-np.pi / 2, np.pi / 2, 5, endpoint=False):
                T = downward([x, y, PANDA.gripper.grasp_height_m()], yaw)
                asked += 1
                try:
                    q = KINEMATICS.inverse(T, yaw=Yaw.EITHER)
                except SkillFailure:
                    assert np.hypot(x, y) > 0.79, f"({x:.2f}, {y:.2f}) m should be in reach"
                    continue
                check_collisions(PANDA, q[None])
                reached += 1
    with capsys.disabled():
        print(f"\nreach at table height: {reached}/{asked} = {reached / asked:.1%}")
    assert reached / asked > 0.96  # only the two corners beyond 0.79 m are lost


def test_a_pose_out_of_reach_is_refused_with_the_allowed_range() -> None:
    with pytest.raises(SkillFailure, match=r"0\.27 to 0\.79 m") as failure:
        KINEMATICS.inverse(downward([0.9, 0.0, 0.1], 0.0))
    assert failure.value.reason == "unreachable"
    assert not KINEMATICS.reachable(downward([0.9, 0.0, 0.1], 0.0))
    assert KINEMATICS.reachable(downward([0.5, 0.0, 0.1], 0.0))


def test_a_base_elsewhere_moves_the_reach_with_it() -> None:
    T_world_base = downward([1.0, 0.0, 0.0], 0.0)  # any rotation will do; upright ones are tested below
    moved = ArmKinematics(PANDA, T_world_base)
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.1, 1.7, 0.4])
    expected = compose(T_world_base, KINEMATICS.forward(q))
    np.testing.assert_allclose(matrix(moved.forward(q)), matrix(expected), atol=1e-9)
    upright = ArmKinematics(PANDA, pose([0.0, 0.8, 0.0]))
    T = downward([0.5, 0.8, 0.1], 0.3)
    np.testing.assert_allclose(upright.inverse(T), KINEMATICS.inverse(downward([0.5, 0.0, 0.1], 0.3)), atol=1e-9)


def test_it_can_be_pickled_for_a_worker_process() -> None:
    KINEMATICS.inverse(tilted(downward([0.5, 0.0, 0.2], 0.0), (0.2, 0.0)))  # the solver exists now
    data = pickle.dumps(ArmKinematics(arm_model("panda"), pose([0.1, 0.0, 0.0])))
    assert len(data) < 2000
    T = downward([0.5, 0.0, 0.1], 0.0)
    expected = ArmKinematics(PANDA, pose([0.1, 0.0, 0.0])).inverse(T)
    np.testing.assert_array_equal(pickle.loads(data).inverse(T), expected)


def test_reachability_is_fast_enough_for_planning() -> None:
    grasps = random_grasps(100)
    began = time.process_time()
    for T in grasps:
        KINEMATICS.reachable(T)
    # 0.15 ms each on an idle core; ten times that still keeps planning fast on a loaded machine.
    assert (time.process_time() - began) / len(grasps) < 2e-3
