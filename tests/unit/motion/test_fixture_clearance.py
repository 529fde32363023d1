"""Distances between arm and fixtures: against MuJoCo's, and never above what a dense search along a path finds."""

import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import FINGER_LINKS, HAND
from dlokit.description.arm.mounts import arm_model
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.description.scene import Box, Fixture, Post
from dlokit.motion.fixture_clearance import (
    FINGER_ERROR_M,
    FIXTURE_TURN_RAD,
    RESOLUTION_M,
    arm_solids,
    fixture_solids,
    gap_m,
    gaps_m,
    hand_clearance_m,
    part_links,
)
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.types.arrays import Float64Array

KINEMATICS = ArmKinematics(PANDA)
OF_HAND = [number for number, link in enumerate(part_links(PANDA)) if link in (HAND, *FINGER_LINKS)]


def rounded_box(rng: np.random.Generator, *, line: bool) -> Float64Array:
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    half = rng.uniform(0.002, 0.04, 3) * ((0.0, 0.0, 1.0) if line else (1.0, 1.0, 1.0))
    radius = rng.uniform(0.001, 0.02) if line else 0.0
    return np.concatenate((axes.ravel(), rng.uniform(-0.05, 0.05, 3), half, [radius]))


def mujoco_distance_m(solids: tuple[Float64Array, Float64Array]) -> float:
    spec = mujoco.MjSpec()
    for solid in solids:
        body = spec.worldbody.add_body(pos=solid[9:12])
        line = solid[12] == 0.0
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE if line else mujoco.mjtGeom.mjGEOM_BOX,
            size=(solid[15], solid[14], 0.0) if line else solid[12:15],
            xyaxes=solid[:6],
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)


@pytest.mark.parametrize("lines", [(True, True), (True, False), (False, True), (False, False)])
def test_distances_of_lines_and_boxes_turned_in_space_are_those_of_mujoco(lines: tuple[bool, bool]) -> None:
    rng = np.random.default_rng(1)
    apart = 0
    for _ in range(60):
        first, second = (rounded_box(rng, line=line) for line in lines)
        first[:9] *= np.linalg.det(first[:9].reshape(3, 3))  # right-handed, as xyaxes are
        second[:9] *= np.linalg.det(second[:9].reshape(3, 3))
        expected = mujoco_distance_m((first, second))
        if expected <= 0.0:
            assert gap_m(first, second) <= 1e-6
            continue
        apart += 1
        assert gap_m(first, second) == pytest.approx(expected, abs=2e-6)  # its iterations end there
    assert apart > 20


def test_far_parts_get_a_lower_bound() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        first, second = (rounded_box(rng, line=line) for line in (True, False))
        second[9:12] += (0.3, 0.2, 0.0)
        assert 0.1 < gap_m(first, second) <= mujoco_distance_m((first, second)) + 2e-6


@pytest.mark.parametrize("name", ["panda", "ur5e"])
@pytest.mark.parametrize("width_m", [0.0, 0.03])
def test_all_that_collides_in_the_cell_is_inside_the_parts(name: str, width_m: float) -> None:
    arm = arm_model(name)
    spec = mujoco.MjSpec()
    add_arm(spec, arm, visual=False)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[: len(arm.joints)], data.qpos[len(arm.joints) :] = arm.home_q_rad, width_m / 2.0
    mujoco.mj_kinematics(model, data)
    parts = arm_solids(arm, arm.home_q_rad, width_m)[0]
    assert model.ngeom == len(parts)
    for geom in range(model.ngeom):
        T = geometry.homogeneous(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        size = model.geom_size[geom]
        box = model.geom_type[geom] == int(mujoco.mjtGeom.mjGEOM_BOX)
        corners = size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        points = corners if box else np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]])
        around = 0.0 if box else size[0]
        for point in points @ T[:3, :3].T + T[:3, 3]:
            ball = np.concatenate((np.eye(3).ravel(), point, np.zeros(3), [around]))
            assert min(gap_m(ball, part) for part in parts) <= -2.0 * around + 1e-9


def test_a_post_with_a_flat_head_is_inside_its_solid_and_one_that_is_turned_by_a_degree_too() -> None:
    for rpy_deg in ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, -1.0, 0.0)):
        post = Post(name="flat", position_m=(0.5, 0.1, 0.0), rpy_deg=rpy_deg, diameter_m=0.02, height_m=0.03)
        angle = np.linspace(0.0, 2.0 * np.pi, 60)
        rim = np.column_stack((0.01 * np.cos(angle), 0.01 * np.sin(angle), np.full(60, 0.03)))
        believed = fixture_solids((replace(post, rpy_deg=(0.0, 0.0, 0.0)),))[0]
        for point in geometry.transform(post.T_world_foot, rim):
            assert gap_m(np.concatenate((np.eye(3).ravel(), point, np.zeros(4))), believed) <= 0.0


def scene(seed: int) -> tuple[Fixture, ...]:
    rng = np.random.default_rng(seed)
    posts = [
        Post(name=f"post{i}", position_m=(*rng.uniform((0.4, -0.1), (0.6, 0.1)), 0.0), height_m=rng.uniform(0.01, 0.06))
        for i in range(3)
    ]
    box = Box(
        name="box",
        position_m=(*rng.uniform((0.4, -0.1), (0.6, 0.1)), 0.0),
        rpy_deg=tuple(rng.uniform(-180.0, 180.0, 3).tolist()),
        size_m=(0.02, 0.04, 0.03),
    )
    return (*posts, box)


def dense_m(path: Float64Array, width_m: float, fixtures: tuple[Fixture, ...]) -> float:
    """Least distance of hand and fingers on a fine grid of the path, with the arm's own kinematics."""
    rows = np.concatenate([np.linspace(a, b, 80) for a, b in itertools.pairwise(path)])
    q = np.array([KINEMATICS.inverse(geometry.downward(row[:3], row[3])) for row in rows])
    return float(gaps_m(arm_solids(PANDA, q, width_m)[:, OF_HAND], fixture_solids(fixtures)).min())


@pytest.mark.heavy
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 0.08))
def test_the_clearance_of_a_path_is_never_above_a_dense_search_and_near_it(seed: int, width_m: float) -> None:
    rng = np.random.default_rng(seed)
    path = np.column_stack((rng.uniform((0.4, -0.1, 0.011), (0.6, 0.1, 0.12), (4, 3)), rng.uniform(-0.6, 0.6, 4)))
    fixtures = scene(seed)
    bound, dense = hand_clearance_m(PANDA, path, width_m, fixtures), dense_m(path, width_m, fixtures)
    assert bound <= dense + 1e-9
    # Two places of the search are up to 3 mm apart.
    assert bound >= min(dense - 0.1 * max(dense, 0.0), 0.09) - RESOLUTION_M - 0.002


def test_a_hand_at_rest_and_a_path_that_stays_there_have_the_same_clearance() -> None:
    fixtures = scene(3)
    place = np.array([[0.5, 0.0, 0.05, 0.3]])
    alone = hand_clearance_m(PANDA, place, 0.02, fixtures)
    assert hand_clearance_m(PANDA, np.repeat(place, 3, axis=0), 0.02, fixtures) == pytest.approx(alone, abs=1e-12)


def test_without_fixtures_every_path_is_clear() -> None:
    assert hand_clearance_m(PANDA, np.zeros((2, 4)), 0.0, ()) == np.inf


def test_a_post_between_two_waypoints_is_found_and_an_early_end_says_only_that_there_is_one() -> None:
    post = (Post(name="thin", position_m=(0.5, 0.0, 0.0), diameter_m=0.004),)
    path = np.array([[0.5, -0.15, 0.011, 0.0], [0.5, 0.15, 0.011, 0.0]])
    assert hand_clearance_m(PANDA, path, 0.0, post) < -0.001
    assert hand_clearance_m(PANDA, path, 0.0, post, enough_m=0.004) <= 0.004
    raised = path + np.array([0.0, 0.0, 0.04, 0.0])
    assert hand_clearance_m(PANDA, raised, 0.0, post, enough_m=0.004) == hand_clearance_m(PANDA, raised, 0.0, post)


def test_fingers_that_open_come_nearer_by_half_the_width() -> None:
    post = (Post(name="beside", position_m=(0.5, 0.04, 0.0), height_m=0.013),)
    place = np.array([[0.5, 0.0, 0.011, 0.0]])  # fingers open along y
    closed, opened = (hand_clearance_m(PANDA, place, width_m, post) for width_m in (0.0, 0.01))
    assert closed - opened == pytest.approx(0.005, abs=1e-4)  # the fingers lean
    outer_m = 0.019 + FINGER_ERROR_M  # of the lower capsule
    widened_m = FIXTURE_TURN_RAD * np.linalg.norm((0.013, 0.005, 0.005))
    assert closed == pytest.approx(0.04 - outer_m - 0.005 - widened_m, abs=5e-4)
