from functools import reduce

import mujoco
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.panda import PANDA_DH, PANDA_HOME_Q_RAD, PANDA_OPEN_WIDTH_M
from dlokit.description.arm.panda_model import add_panda
from dlokit.skills.viewer.robot_figure import MeshStore, finger_pose, joint_pose
from dlokit.types.arrays import Float64Array


@pytest.fixture(scope="module")
def panda() -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    add_panda(spec)
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("q_rad", [np.zeros(7), PANDA_HOME_Q_RAD, np.array([0.3, -0.5, 0.7, -1.9, 0.4, 2.1, -1.1])])
def test_links_have_the_poses_of_the_simulated_arm(
    panda: tuple[mujoco.MjModel, mujoco.MjData], q_rad: Float64Array
) -> None:
    model, data = panda
    data.qpos[:7] = q_rad
    mujoco.mj_kinematics(model, data)
    link7 = reduce(geometry.compose, (joint_pose(joint, float(q)) for joint, q in zip(PANDA_DH, q_rad, strict=True)))
    # Both compute the same closed form in double precision.
    np.testing.assert_allclose(link7.position_m, data.body("panda/link7").xpos, atol=1e-9)
    np.testing.assert_allclose(geometry.rotation(link7), data.body("panda/link7").xmat.reshape(3, 3), atol=1e-9)


@pytest.mark.parametrize(("side", "number"), [("left", 1), ("right", 2)])
def test_fingers_have_the_poses_of_the_simulated_hand(
    panda: tuple[mujoco.MjModel, mujoco.MjData], side: str, number: int
) -> None:
    model, data = panda
    data.joint(f"panda/finger_joint{number}").qpos[0] = PANDA_OPEN_WIDTH_M / 2
    mujoco.mj_kinematics(model, data)
    hand = geometry.pose(data.body("panda/hand").xpos, data.body("panda/hand").xquat)
    finger = geometry.compose(hand, finger_pose(side, PANDA_OPEN_WIDTH_M))
    np.testing.assert_allclose(finger.position_m, data.body(f"panda/{side}_finger").xpos, atol=1e-9)


def test_a_mesh_is_read_once_and_both_fingers_share_theirs() -> None:
    store = MeshStore()
    assert store.link("left_finger") is store.link("right_finger")
