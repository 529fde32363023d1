"""The Panda's description against Franka's documentation, its own meshes, and MuJoCo."""

from typing import Any

import mujoco
import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.geometry import downward, pose, rotation
from dlokit.motion.forward_kinematics import (
    capsule_ends,
    joint_link_transforms,
    link_transforms,
    tcp_matrices,
    tcp_pose,
)


def random_q(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    return rng.uniform(PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad, (count, 7))


@pytest.fixture(scope="module")
def model() -> Any:
    spec = mujoco.MjSpec()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    add_arm(spec, PANDA, name="panda")
    return spec.compile()


def test_the_flange_is_where_the_documentation_says() -> None:
    # All joints at zero: 0.333 + 0.316 + 0.384 - 0.107 m up, 0.088 m ahead, looking down.
    flange = joint_link_transforms(PANDA, np.zeros(7))[0, 7] @ np.array([0.0, 0.0, 0.107, 1.0])
    np.testing.assert_allclose(flange[:3], [0.088, 0.0, 0.926], atol=1e-12)
    # The documentation's ready posture brings the tool to (0.307, 0, 0.487) m.
    ready = tcp_pose(PANDA, np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4]))
    np.testing.assert_allclose(ready.position_m, [0.307, 0.0, 0.487], atol=5e-4)


def test_the_model_and_the_plain_kinematics_agree_on_every_link(model: Any) -> None:
    data = mujoco.MjData(model)
    for q in random_q(5):
        data.qpos[:7], data.qpos[7:] = q, 0.02
        mujoco.mj_forward(model, data)
        T = link_transforms(PANDA, q, finger_width_m=0.04)[0]
        for i, link in enumerate(PANDA.links):
            body = data.body(f"panda/{link}")
            np.testing.assert_allclose(T[i, :3, 3], body.xpos, atol=1e-9)
            np.testing.assert_allclose(T[i, :3, :3], body.xmat.reshape(3, 3), atol=1e-9)
        np.testing.assert_allclose(tcp_matrices(PANDA, q)[0, :3, 3], data.site("panda/tcp").xpos, atol=1e-9)


def test_at_home_the_gripper_points_down_along_x() -> None:
    home = tcp_pose(PANDA, PANDA.home_q_rad)
    np.testing.assert_allclose(rotation(home), rotation(downward([0, 0, 0], 0.0)), atol=1e-5)


@pytest.mark.parametrize("camera_x_m", [0.515, 0.415], ids=["left", "right"])
def test_at_home_the_arm_hides_nothing_of_the_table_from_the_camera(camera_x_m: float) -> None:
    # Lines of sight to the table from x = 0.30 m on are beyond the plane through the camera and that edge.
    camera_z_m, edge_x_m = 1.011, 0.30
    normal = np.array([1.0, 0.0, -(camera_x_m - edge_x_m) / camera_z_m])
    start, end = capsule_ends(PANDA, PANDA.home_q_rad)
    radii = PANDA.radii_m
    beyond = np.maximum(start[0] @ normal, end[0] @ normal) - edge_x_m
    assert np.max(beyond / np.linalg.norm(normal) + radii) < -0.02  # 2 cm clear of any line of sight


def mesh_vertices(link: str) -> np.ndarray:
    triangle = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")])
    content = PANDA.surfaces[link][0].path.read_bytes()
    return np.frombuffer(content[84:], dtype=triangle)["corners"].reshape(-1, 3).astype(np.float64)


@pytest.mark.parametrize("link", PANDA.links)
def test_the_capsules_of_a_link_enclose_its_mesh(link: str) -> None:
    vertices = mesh_vertices(link)
    gaps: list[np.ndarray] = []
    for capsule in PANDA.capsules:
        if capsule.link == link:
            start, end = np.array(capsule.start_m), np.array(capsule.end_m)
            along = np.clip((vertices - start) @ (end - start) / np.sum((end - start) ** 2), 0.0, 1.0)
            gaps.append(np.linalg.norm(vertices - start - along[:, None] * (end - start), axis=1) - capsule.radius_m)
    # The foot of the base sticks out most; nothing comes near it.
    assert np.max(np.min(gaps, axis=0)) < (0.03 if link == "link0" else 0.012)


def test_the_fingers_open_along_y_of_the_tool_by_the_commanded_width() -> None:
    spec = mujoco.MjSpec()
    add_arm(spec, PANDA, name="panda", T_world_base=pose([1.0, 2.0, 0.0]), visual=False)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7], data.qpos[7:] = PANDA.home_q_rad, 0.03
    mujoco.mj_forward(model, data)
    site = data.site("panda/tcp")
    half_pad = 0.005  # distance of the pads' inner faces from their centres
    for side, sign in (("left", 1.0), ("right", -1.0)):
        offset = site.xmat.reshape(3, 3).T @ (data.geom(f"panda/pad_{side}").xpos - site.xpos)
        np.testing.assert_allclose(offset, [0.0, sign * (0.03 + half_pad), 0.0], atol=1e-9)
    np.testing.assert_allclose(site.xpos - tcp_pose(PANDA, PANDA.home_q_rad).position_m, [1.0, 2.0, 0.0], atol=1e-9)
    assert pytest.approx(0.1034) == PANDA.gripper.tcp_m  # Franka's nominal end effector


def test_a_holding_arm_stays_in_place_with_gravity_compensated(model: Any) -> None:
    data = mujoco.MjData(model)
    data.qpos[:7] = data.ctrl[:7] = PANDA.home_q_rad
    mujoco.mj_step(model, data, 500)
    np.testing.assert_allclose(data.qpos[:7], PANDA.home_q_rad, atol=1e-6)
    assert np.max(np.abs(data.actuator_force[:7])) < 0.01  # [N·m]; link 2 alone weighs 30 N·m without compensation


def test_the_fingers_move_together_when_one_is_pushed(model: Any) -> None:
    data = mujoco.MjData(model)
    data.qpos[:7] = data.ctrl[:7] = PANDA.home_q_rad
    data.qpos[7:] = 0.02
    data.ctrl[7:] = 0.02
    data.qfrc_applied[7] = 10.0
    mujoco.mj_step(model, data, 500)
    # 10 N against two actuators of 2 kN/m: 2.5 mm, shared to within what the belt gives.
    np.testing.assert_allclose(data.qpos[7:], 0.0225, atol=2e-4)
