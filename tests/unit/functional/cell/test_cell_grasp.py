"""A whole frictional pick-and-place by the arm's own controller."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.description.dlo import SOFT_ROPE, WIRE_A, DloPreset
from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.config import CellConfig, DloPhysics, ElasticRod, ElastoplasticChain
from dlokit.functional.cell.world import Cell
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory, RobotMode

NODE = 20
LIFT_M = 0.05
CARRY_M = np.array([0.15, 0.26])  # 30 cm


class Kinematics:
    """Damped least squares from a near start, on a Panda alone."""

    def __init__(self) -> None:
        spec = mujoco.MjSpec()
        add_arm(spec, PANDA, name="panda")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.site = self.model.site("panda/tcp").id

    def joint_angles(self, target: Pose, q_rad: Float64Array) -> Float64Array:
        jacobian = np.zeros((6, self.model.nv))
        q = q_rad.copy()
        for _ in range(60):
            self.data.qpos[:7] = q
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_jacSite(self.model, self.data, jacobian[:3], jacobian[3:], self.site)
            J = jacobian[:, :7]
            turn = geometry.rotation(target) @ self.data.site_xmat[self.site].reshape(3, 3).T
            away = target.position_m - self.data.site_xpos[self.site]
            error = np.concatenate((away, Rotation.from_matrix(turn).as_rotvec()))
            if np.linalg.norm(error) < 1e-8:
                break
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), error)
        return q


KINEMATICS = Kinematics()


def move(cell: Cell, start: Pose, end: Pose, duration_s: float) -> None:
    """A straight line with a minimum-jerk profile, through joint space."""
    times = np.linspace(0.0, duration_s, round(duration_s / 0.05) + 1)
    u = times / duration_s
    parts = u**3 * (10 - 15 * u + 6 * u**2)
    angles = [cell.arm.setpoint(cell.time_s).q_rad]
    for part in parts[1:]:
        place = start.position_m + part * (end.position_m - start.position_m)
        angles.append(KINEMATICS.joint_angles(Pose(position_m=place, wxyz=end.wxyz), angles[-1]))
    q = np.array(angles)
    dq = np.gradient(q, times, axis=0)
    dq[[0, -1]] = 0.0
    trajectory = JointTrajectory(times_s=times, q_rad=q, dq_rad_s=dq, ddq_rad_s2=np.gradient(dq, times, axis=0))
    cell.arm.start_follow(trajectory, cell.time_s)
    cell.step(duration_s + 0.2)


@pytest.mark.parametrize(
    ("physics", "dlo"),
    [(ElasticRod(), SOFT_ROPE), (ElastoplasticChain(), WIRE_A)],
    ids=["rod, soft rope", "chain, wire"],
)
def test_a_frictional_grasp_lifts_carries_and_releases_the_rope(physics: DloPhysics, dlo: DloPreset):
    cell = Cell(CellConfig(physics=physics, dlo=dlo), seed=0)
    cell.place_dlo(builtin_shape("I", 0.5, 200))
    place = cell.true_nodes_world()[NODE, :2]
    goal = place + CARRY_M * (-1, 1)

    def tool(xy: Float64Array, height_m: float) -> Pose:
        return geometry.downward([*xy, height_m], np.pi / 2)

    move(cell, cell.arm_state().T_world_tcp, tool(place, 0.12), 2.0)
    cell.arm.fingers.start_grip(0.04, 20.0)
    cell.step(0.5)
    assert not cell.arm_state().holding
    move(cell, tool(place, 0.12), tool(place, PANDA.gripper.grasp_height_m()), 1.0)
    cell.arm.fingers.start_grip(0.0, 20.0)
    cell.step(1.2)
    assert cell.arm.fingers.result().held
    move(cell, tool(place, PANDA.gripper.grasp_height_m()), tool(place, LIFT_M), 0.6)
    held_above_m = LIFT_M - PANDA.gripper.grasp_height_m()
    assert cell.true_nodes_world()[NODE, 2] > 0.8 * held_above_m
    move(cell, tool(place, LIFT_M), tool(goal, LIFT_M), 2.3)
    assert cell.arm_state().holding
    move(cell, tool(goal, LIFT_M), tool(goal, PANDA.gripper.grasp_height_m()), 0.6)
    # It must not slip: 2 mm is half the rope's radius.
    assert np.linalg.norm(cell.true_nodes_world()[NODE, :2] - goal) < 0.002
    cell.arm.fingers.start_grip(0.04, 20.0)
    cell.step(0.6)
    assert not cell.arm_state().holding
    move(cell, tool(goal, PANDA.gripper.grasp_height_m()), tool(goal, 0.12), 0.6)
    cell.step(1.0)
    left = cell.true_nodes_world()[NODE]
    assert left[2] < 0.006  # on the table: the radius is 4 mm
    # The rope is no longer held straight and springs back due to the adjacent bends; measured 8 mm.
    assert np.linalg.norm(left[:2] - goal) < 0.015


def test_fingers_that_close_on_nothing_hold_nothing():
    cell = Cell(CellConfig(), seed=0)
    cell.arm.fingers.start_grip(0.0, 20.0)
    cell.step(1.5)
    result = cell.arm.fingers.result()
    assert cell.arm.fingers.at_rest
    assert not result.held
    assert result.width_m == pytest.approx(0.0, abs=0.001)  # compliance of the soft stop of a finger's joint


def test_fingers_open_to_the_width_asked_for():
    cell = Cell(CellConfig(), seed=0)
    cell.arm.fingers.start_grip(0.03, 20.0)
    cell.step(1.0)
    assert cell.arm.fingers.result().width_m == pytest.approx(0.03, abs=2e-4)  # stiffness against the joint's damping


def test_braking_keeps_the_limits_and_comes_to_rest():
    cell = Cell(CellConfig(), seed=0)
    q0 = cell.arm.q_rad
    speed = np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    times = np.array([0.0, 0.4, 2.0, 2.4])
    q = q0 + np.array([0.0, 0.2, 1.8, 2.0])[:, None] * speed
    trajectory = JointTrajectory(
        times_s=times, q_rad=q, dq_rad_s=np.stack([0 * speed, speed, speed, 0 * speed]), ddq_rad_s2=np.zeros((4, 7))
    )
    cell.arm.start_follow(trajectory, cell.time_s)
    cell.step(0.6)
    assert cell.arm.mode == RobotMode.MOVING
    cell.arm.brake(cell.time_s)
    start_s = cell.time_s
    velocities = [cell.arm.setpoint(start_s + k * 0.0025).dq_rad_s for k in range(400)]
    accelerations = np.diff(velocities, axis=0) / 0.0025
    assert np.all(np.abs(accelerations) <= PANDA.limits.acceleration_rad_s2 * 1.001)  # rounding of differences
    jerks = np.diff(accelerations, axis=0) / 0.0025
    assert np.all(np.abs(jerks) <= PANDA.limits.jerk_rad_s3 * 1.01)
    cell.step(1.0)
    assert cell.arm.mode == RobotMode.IDLE
    assert np.abs(cell.arm_state().dq_rad_s).max() < 1e-3  # rad/s, at rest


def test_fingers_that_lost_the_rope_close_and_no_longer_hold() -> None:
    cell = Cell(CellConfig(), seed=0)
    cell.place_dlo(builtin_shape("I", 0.5, 200), settle=False)
    place = cell.true_nodes_world()[NODE, :2]
    low = geometry.downward([*place, PANDA.gripper.grasp_height_m()], np.pi / 2)
    cell.arm.fingers.start_grip(0.04, 20.0)
    move(cell, cell.arm_state().T_world_tcp, low, 2.0)
    cell.arm.fingers.start_grip(0.0, 20.0)
    cell.step(1.0)
    assert cell.arm_state().holding
    # It slips out: from one step to the next, its position changes.
    cell.place_dlo(builtin_shape("I", 0.5, 200) + np.array([0.15, 0.0, 0.0]), settle=False)
    cell.step(0.3)
    assert not cell.arm_state().holding
