import numpy as np
import pytest
from msgspec.structs import replace
from stereo_scene import calibration, robot_state

from dlokit.description.arm.franka import PANDA
from dlokit.geometry import inverse, pose, transform
from dlokit.geometry.camera import project
from dlokit.motion.forward_kinematics import link_transforms
from dlokit.skills.perception.self_filter import (
    Capsules,
    PosedArm,
    occlusion_map,
    robot_capsules,
    robot_distance_m,
    robot_outline,
)

OVER_TABLE_Q_RAD = np.array([-0.1, 0.35, 0.05, -2.2, 0.0, 2.5, 0.8])


def test_distance_is_to_the_nearest_surface_and_negative_inside():
    capsule = Capsules(
        starts_world=np.array([[0.0, 0, 0]]), ends_world=np.array([[0.0, 0, 1]]), radii_m=np.array([0.1])
    )
    points = np.array([[0.3, 0.0, 0.5], [0.0, 0.0, 1.3], [0.05, 0.0, 0.5]])
    np.testing.assert_allclose(robot_distance_m(points, capsule), [0.2, 0.2, -0.05])


def test_points_on_the_gripper_are_removed_and_a_rope_two_centimetres_away_is_not():
    frames = dict(zip(PANDA.links, link_transforms(PANDA, OVER_TABLE_Q_RAD, 0.02)[0], strict=True))
    capsules = robot_capsules((PosedArm(PANDA, robot_state(OVER_TABLE_Q_RAD, finger_width_m=0.02)),))
    on_pad = frames["left_finger"] @ [0.0, 0.01, 0.045, 1.0]
    tip_below = frames["hand"] @ [0.0, 0.0, 0.1034 + 0.0089 + 0.02, 1.0]
    assert robot_distance_m(on_pad[None, :3], capsules)[0] < 0.0
    assert robot_distance_m(tip_below[None, :3], capsules)[0] > 0.006


def test_without_a_robot_nothing_is_removed():
    capsules = robot_capsules(())
    assert np.isinf(robot_distance_m(np.zeros((3, 3)), capsules)).all()
    assert not robot_outline(capsules, calibration(), 0.01).any()
    assert np.isinf(occlusion_map(capsules, calibration(), 8).depth_m).all()


def test_outline_and_occlusion_agree_on_what_the_robot_hides():
    camera = calibration()
    capsules = robot_capsules((PosedArm(PANDA, robot_state(OVER_TABLE_Q_RAD)),))
    hidden = np.isfinite(occlusion_map(capsules, camera, 8).depth_m)
    middles = robot_outline(capsules, camera, 0.0)[4::8, 4::8]
    assert hidden.sum() > 200
    # They may differ along the rim only, where the outline takes a sphere's picture for a circle.
    assert np.count_nonzero(hidden != middles) < 0.1 * hidden.sum()


def test_the_occlusion_map_has_the_depth_of_the_nearest_surface():
    camera = calibration()
    center = np.array([0.5, 0.1, 0.4])
    ball = Capsules(starts_world=center[None], ends_world=center[None] + 1e-9, radii_m=np.array([0.08]))
    seen = project(center[None], camera)
    column, row = (seen.pixels[0] // 8).astype(int)
    middle = (np.array([column, row]) + 0.5) * 8 - 0.5
    # Depth of the ray through the middle of that cell into the ball, from the sphere's own equation.
    ray = np.array([(middle[0] - camera.cx_px) / camera.fx_px, (middle[1] - camera.cy_px) / camera.fy_px, 1.0])
    c = transform(inverse(camera.T_world_camera), center[None])[0]
    roots = np.roots([ray @ ray, -2 * ray @ c, c @ c - 0.08**2])
    assert occlusion_map(ball, camera, 8).depth_m[row, column] == pytest.approx(roots.min(), abs=1e-5)


def test_a_robot_with_another_base_pose_is_filtered_there():
    base = pose((1.04, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    state = robot_state(OVER_TABLE_Q_RAD)
    here = robot_capsules((PosedArm(PANDA, state),))
    both = robot_capsules([PosedArm(PANDA, each) for each in (state, replace(state, T_world_base=base))])
    count = len(here.starts_world)
    np.testing.assert_allclose(both.starts_world[:count], here.starts_world)
    np.testing.assert_allclose(both.starts_world[count:], transform(base, here.starts_world), atol=1e-12)
    np.testing.assert_allclose(both.ends_world[count:], transform(base, here.ends_world), atol=1e-12)
