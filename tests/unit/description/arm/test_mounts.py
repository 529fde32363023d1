"""Mounting poses of the arms: together they reach the whole usable table."""

import numpy as np

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.installation import Installation
from dlokit.description.shapes import CENTRE_M
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw

ARMS = Installation().mounts(2)


def test_the_second_arm_is_the_first_turned_by_half_a_turn_about_the_middle_of_the_table() -> None:
    first, second = (ArmKinematics(PANDA, mount.T_world_base) for mount in ARMS)
    q_rad = np.array([0.2, 0.4, 0.0, -2.1, 0.1, 2.5, 0.7])
    here, there = first.forward(q_rad), second.forward(q_rad)
    np.testing.assert_allclose((here.position_m + there.position_m)[:2] / 2.0, CENTRE_M, atol=1e-12)
    np.testing.assert_allclose(ARMS[1].place_m, [1.04, 0.0], atol=1e-12)


def test_each_arm_reaches_the_usable_table_but_its_far_corners_and_both_together_reach_all_of_it() -> None:
    places = [(x, y) for x in np.linspace(*TABLE_X_M, 7) for y in np.linspace(*TABLE_Y_M, 7)]
    reached = np.array([[_reaches(mount, x, y) for x, y in places] for mount in ARMS])
    assert reached.any(axis=0).all()
    assert np.all(reached.mean(axis=1) > 0.9)  # 47 of 49 each


def _reaches(mount: ArmMount, x: float, y: float) -> bool:
    across = np.arctan2(y - mount.place_m[1], x - mount.place_m[0]) + np.pi / 4
    pose = geometry.downward((x, y, PANDA.gripper.grasp_height_m()), across)
    return ArmKinematics(PANDA, mount.T_world_base).reachable(pose, Yaw.EITHER)


def test_the_first_arm_needs_no_name_on_the_bus() -> None:
    assert [mount.instance for mount in ARMS] == ["", "second"]
