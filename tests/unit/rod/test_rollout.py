"""The planning rod: against statics, and the same for any number of threads."""

from dataclasses import replace

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.shapes import builtin_shape, random_shape
from dlokit.motion.tool_track import tool_track
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import Motion, PlanningRod, closed_fingers, simulate
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array

MODEL = BelievedDlo()
I_SHAPE = builtin_shape("I", MODEL.length_m, MODEL.nodes)  # along y
PACE = VelocityProfile()
STEP_S = 0.005


def carried(node: int, *by_m: tuple[float, float, float], pace: VelocityProfile = PACE) -> Motion:
    """The tool grasps the straight rod at `node` and moves it by `by_m`."""
    grasp = np.array([*I_SHAPE[node, :2], 0.011, np.pi / 2])
    waypoints = np.stack([grasp, *(grasp + np.array([*step, 0.0]) for step in by_m)])
    return Motion(node=node, waypoints=waypoints, velocity=pace)


def played(motion: Motion, rod: PlanningRod | None = None, config: BelievedDlo = MODEL) -> Float64Array:
    return simulate(config, I_SHAPE, (rod or PlanningRod(),), (motion,), STEP_S).nodes_world[0, 0]


def test_closed_fingers_are_as_wide_as_the_gripper_says_or_as_its_pads() -> None:
    assert closed_fingers(FRANKA_HAND).tolist() == [0.0085, 0.009, 0.0089]
    pads = replace(
        FRANKA_HAND, closed_half_width_m=None, pad_half_thickness_m=0.008, tip_drop=((0.0, 0.002), (0.08, 0.0))
    )
    assert closed_fingers(pads) == pytest.approx([0.007, 0.009, 0.0109])
    thin = replace(pads, pad_half_thickness_m=0.002)
    assert closed_fingers(thin)[0] == 0.0, "thinner than long: a post"


def test_a_pulled_rod_follows_its_end_and_keeps_its_length() -> None:
    after = played(carried(30, (0.0, 0.0, 0.003), (0.0, 0.1, 0.003), (0.0, 0.1, 0.0)))
    assert np.abs(after - I_SHAPE - [0.0, 0.1, 0.0]).max() < 0.003  # the pads and the edges are slightly compliant
    assert geometry.arc_lengths(after)[-1] == pytest.approx(MODEL.length_m, abs=0.002)


def test_the_held_node_is_where_the_tool_released_it_and_far_nodes_have_not_moved() -> None:
    after = played(carried(30, (0.0, 0.0, 0.04), (0.03, -0.005, 0.04), (0.03, -0.005, 0.0)))
    # A rod of these parameters in MuJoCo springs back by (3.6, 3.3) mm when it is released; the pads hold it softly.
    assert np.linalg.norm(after[30] - I_SHAPE[30] - [0.0336, -0.0017, 0.0]) < 0.0015
    assert np.abs((after - I_SHAPE)[:10, 0]).max() < 0.001  # lifting draws them along the rod


def test_a_curve_that_friction_holds_stays_and_one_that_it_does_not_springs_back() -> None:
    curve = random_shape(np.random.default_rng(3), MODEL.length_m, MODEL.nodes)
    away = Motion(node=0, waypoints=np.array([[*curve[0, :2], 0.011, 0.0]] * 2), velocity=PACE)
    for stiffness, least_m, most_m in ((1.0, 0.0, 0.002), (40.0, 0.004, 1.0)):
        end = simulate(MODEL, curve, (PlanningRod(stiffness_factor=stiffness),), (away,), STEP_S).nodes_world[0, 0]
        assert least_m <= geometry.rmse_m(end, curve) < most_m


def test_a_model_with_twice_the_nodes_predicts_the_same_lay_down() -> None:
    # A rod that hangs from the pads is laid down as an S: with the model's edge length, the two differ by 5 mm.
    goal, lift_m, ends = builtin_shape("S", MODEL.length_m, 31), 0.44, list[Float64Array]()
    over = goal[2::3] - I_SHAPE[30]
    path = [(float(x), float(y), lift_m * (1.0 - k / 9.0)) for k, (x, y, _) in enumerate(over)]
    for nodes in (31, 61):
        start, motion = builtin_shape("I", MODEL.length_m, nodes), carried(30, (0.0, 0.0, lift_m), *path)
        rod = replace(MODEL, nodes=nodes)
        end = simulate(rod, start, (PlanningRod(),), (replace(motion, node=nodes - 1),), STEP_S).nodes_world[0, 0]
        ends.append(geometry.resample(end, 31))
    assert geometry.rmse_m(*ends) < 0.003


def test_the_result_is_the_same_for_any_number_of_threads() -> None:
    motions = tuple(carried(node, (0.0, 0.0, 0.04), (0.05, 0.0, 0.04), (0.05, 0.0, 0.0)) for node in (0, 10, 20, 30))
    rods = (PlanningRod(), PlanningRod(friction_factor=0.7))
    one, three = (simulate(MODEL, I_SHAPE, rods, motions, STEP_S, threads) for threads in (1, 3))
    assert np.array_equal(one.nodes_world, three.nodes_world)
    assert np.array_equal(one.nearest_m, three.nearest_m)
    assert one.nodes_world.shape == (2, 4, MODEL.nodes, 3)


def test_the_smallest_distance_between_strands_is_returned() -> None:
    folded = played_nearest(carried(30, (0.0, 0.0, 0.04), (0.0, -0.45, 0.04), (0.0, -0.45, 0.0)))
    straight = played_nearest(carried(30, (0.0, 0.0, 0.04), (0.05, 0.0, 0.04), (0.05, 0.0, 0.0)))
    assert folded < 0.03 < straight


def played_nearest(motion: Motion) -> float:
    return float(simulate(MODEL, I_SHAPE, (PlanningRod(),), (motion,), STEP_S).nearest_m[0, 0])


def test_the_tool_starts_and_ends_at_rest_rounds_corners_and_keeps_its_speed() -> None:
    waypoints = np.array([[0.5, 0.0, 0.01, 0.0], [0.5, 0.0, 0.2, 0.0], [0.5, 0.3, 0.2, 1.0]])
    track = tool_track(waypoints, 0.25, 1.0, 10.0, STEP_S)
    speed = np.linalg.norm(np.diff(track[:, :3], axis=0), axis=1) / STEP_S
    assert np.allclose(track[-1], waypoints[-1], atol=1e-9)
    assert speed.max() < 0.26  # one or two per cent is lost in the discretisation of the path
    assert max(speed[0], speed[-1]) < 0.02
    corner = np.linalg.norm(track[:, :3] - waypoints[1, :3], axis=1).min()
    assert 0.01 < corner < 0.05  # a Bézier curve from 5 cm before to 5 cm after passes at 1.8 cm


def test_the_tool_stops_where_the_path_reverses() -> None:
    waypoints = np.array([[0.5, 0.0, 0.01, 0.0], [0.5, 0.0, 0.11, 0.0], [0.5, 0.0, 0.01, 0.0]])
    track = tool_track(waypoints, 0.25, 1.0, 10.0, STEP_S)
    assert track[:, 2].max() == pytest.approx(0.11, abs=1e-6)


def test_a_rod_bent_above_yield_keeps_its_bends() -> None:
    curve = builtin_shape("S", MODEL.length_m, MODEL.nodes)
    away = Motion(node=0, waypoints=np.array([[*curve[0, :2], 0.011, 0.0]] * 2), velocity=PACE)
    stiff = 100.0  # elastic, it would spring far back
    rods = tuple(PlanningRod(stiffness_factor=stiff, yield_curvature_1_m=bend) for bend in (1.0, 3.0, 1e6, np.inf))
    ends = simulate(MODEL, curve, rods, (away,), STEP_S).nodes_world[:, 0]
    kept_m = [geometry.rmse_m(end, curve) for end in ends]
    assert kept_m[0] < kept_m[1] < kept_m[2]
    assert kept_m[0] < 0.2 * kept_m[3]
    # A yield curvature that is never reached has no effect.
    assert np.abs(ends[2] - ends[3]).max() < 1e-9
