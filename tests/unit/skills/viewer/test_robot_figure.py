from dataclasses import replace
from functools import reduce

import mujoco
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.fitting import link_mesh
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.skills.viewer.robot_figure import finger_pose, joint_pose
from dlokit.types.arrays import Float64Array


@pytest.fixture(scope="module")
def panda() -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    add_arm(spec, PANDA, name="panda")
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("q_rad", [np.zeros(7), PANDA.home_q_rad, np.array([0.3, -0.5, 0.7, -1.9, 0.4, 2.1, -1.1])])
def test_links_have_the_poses_of_the_simulated_arm(
    panda: tuple[mujoco.MjModel, mujoco.MjData], q_rad: Float64Array
) -> None:
    model, data = panda
    data.qpos[:7] = q_rad
    mujoco.mj_kinematics(model, data)
    link7 = reduce(
        geometry.compose, (joint_pose(joint, float(q)) for joint, q in zip(PANDA.joints, q_rad, strict=True))
    )
    # Both compute the same closed form in double precision.
    np.testing.assert_allclose(link7.position_m, data.body("panda/link7").xpos, atol=1e-9)
    np.testing.assert_allclose(geometry.rotation(link7), data.body("panda/link7").xmat.reshape(3, 3), atol=1e-9)


@pytest.mark.parametrize(("side", "number"), [("left", 1), ("right", 2)])
def test_fingers_have_the_poses_of_the_simulated_hand(
    panda: tuple[mujoco.MjModel, mujoco.MjData], side: str, number: int
) -> None:
    model, data = panda
    data.joint(f"panda/finger_joint{number}").qpos[0] = PANDA.gripper.open_width_m / 2
    mujoco.mj_kinematics(model, data)
    hand = geometry.pose(data.body("panda/hand").xpos, data.body("panda/hand").xquat)
    finger = geometry.compose(hand, finger_pose(PANDA.gripper, f"{side}_finger", PANDA.gripper.open_width_m))
    np.testing.assert_allclose(finger.position_m, data.body(f"panda/{side}_finger").xpos, atol=1e-9)


def test_a_link_without_meshes_is_drawn_as_its_capsules() -> None:
    bare = replace(PANDA, surfaces={})
    mesh = link_mesh(bare, "link3", merged=True)
    capsules = [capsule for capsule in bare.capsules if capsule.link == "link3"]
    lowest = np.min([np.minimum(each.start_m, each.end_m) - each.radius_m for each in capsules], axis=0)
    np.testing.assert_allclose(mesh.bounds[0], lowest, atol=2e-3)  # round bodies are drawn with flat faces
