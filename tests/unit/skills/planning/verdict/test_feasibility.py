"""Infeasible shapes: each problem is named with its place."""

from collections.abc import Callable

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.shapes import builtin_shape, moved, random_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict.feasibility import (
    Workplace,
    bends,
    check_start,
    crowded,
    misfits,
    out_of_bounds,
    overlaps,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.feasibility import Problem, Verdict
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

I_SHAPE = builtin_shape("I", 0.5, 31)
LOOKS_DOWN = CameraCalibration(
    width_px=640,
    height_px=560,
    fx_px=722.0,
    fy_px=722.0,
    cx_px=319.5,
    cy_px=279.5,
    T_world_camera=geometry.pose((0.52, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)),
)


def everywhere(T: Pose) -> bool:
    return True


def within_70_cm(T: Pose) -> bool:
    return bool(np.hypot(*T.position_m[:2]) < 0.7)


def workplace(
    camera: CameraCalibration | None = None,
    reachable: Callable[[Pose], bool] = everywhere,
    config: FeasibilityConfig | None = None,
) -> Workplace:
    return Workplace(BelievedDlo(), config or FeasibilityConfig(), reachable, camera)


def of_goal(nodes: Float64Array, camera: CameraCalibration | None = None) -> Verdict:
    config = FeasibilityConfig()
    found = (*out_of_bounds(nodes, workplace(camera)), *overlaps(nodes, 0.004), *bends(nodes, config))
    return Verdict(findings=(*found, *crowded(nodes, workplace())))


def problems(verdict: Verdict) -> list[Problem]:
    return [finding.problem for finding in verdict.findings]


@pytest.mark.parametrize("name", ["I", "S"])
def test_built_in_goals_are_feasible(name: str) -> None:
    assert of_goal(builtin_shape(name, 0.5, 31), LOOKS_DOWN).feasible


def test_random_shapes_are_feasible() -> None:
    for seed in range(5):
        assert of_goal(random_shape(np.random.default_rng(seed), 0.5, 31)).feasible


def test_a_goal_off_the_table_is_named_with_its_worst_node() -> None:
    verdict = of_goal(moved(I_SHAPE, (0.0, 0.3)))
    assert problems(verdict) == [Problem.OFF_TABLE]
    assert verdict.findings[0].node == 30
    assert "0.55" in verdict.text
    assert verdict.reason == "off_table"


def test_a_goal_out_of_reach_is_named() -> None:
    far = moved(I_SHAPE, (0.2, 0.0))
    (finding,) = out_of_bounds(far, workplace(reachable=within_70_cm))
    assert finding.problem is Problem.OUT_OF_REACH
    assert finding.amount == pytest.approx(0.5)  # no node of it can be grasped: the whole rod is out of reach


def test_a_node_out_of_reach_is_allowed_if_a_nearby_one_can_be_grasped() -> None:
    along_x = moved(I_SHAPE, (-0.04, 0.0), np.pi / 2)  # from 0.23 to 0.73 m; the arm reaches 0.70

    assert (
        out_of_bounds(along_x, workplace(config=FeasibilityConfig(table_x_m=(0.0, 1.0)), reachable=within_70_cm)) == ()
    )
    (finding,) = check_start(
        along_x, workplace(config=FeasibilityConfig(table_x_m=(0.0, 1.0)), reachable=within_70_cm)
    ).findings
    assert finding.problem is Problem.OUT_OF_REACH


def test_a_goal_out_of_view_is_named_and_views_are_not_checked_without_a_camera() -> None:
    far = moved(I_SHAPE, (0.22, 0.0), np.pi / 2)
    wide = FeasibilityConfig(table_x_m=(0.0, 2.0))
    (finding,) = out_of_bounds(far, workplace(LOOKS_DOWN, config=wide))
    assert finding.problem is Problem.OUT_OF_VIEW
    assert out_of_bounds(far, workplace(config=wide)) == ()


def test_a_bend_that_is_too_tight_is_named_for_goals_only() -> None:
    # A right angle in 31 nodes is still a bend of 10 mm, which a rope of 4 mm allows; a hairpin is not.
    right_angle = np.array([[0.4, -0.2, 0.004], [0.4, 0.0, 0.004], [0.65, 0.0, 0.004]])
    assert of_goal(geometry.resample(right_angle, 31)).feasible
    hairpin = np.array([[0.4, -0.2, 0.004], [0.4, 0.05, 0.004], [0.5, -0.18, 0.004]])
    nodes = geometry.resample(hairpin, 31)
    assert problems(of_goal(nodes))[0] is Problem.BENDS_TOO_TIGHTLY
    assert check_start(nodes, workplace()).feasible


def test_a_rod_across_itself_is_named() -> None:
    t = np.linspace(0.0, 1.0, 200)
    loop = np.column_stack([0.5 + 0.07 * np.sin(4.2 * np.pi * t), 0.1 * (2 * t - 1) + 0.07 * np.cos(4.2 * np.pi * t)])
    nodes = geometry.resample(np.column_stack([loop, np.full(200, 0.004)]), 31)
    verdict = check_start(nodes, workplace())
    assert Problem.CROSSES_ITSELF in problems(verdict)
    assert "lies across itself" in verdict.text


def hairpin(gap_m: float) -> Float64Array:
    """A rod (31, 3) [m] of two straight strands, `gap_m` apart, and the half circle that joins them."""
    straight = (0.5 - np.pi * gap_m / 2.0) / 2.0
    turn = np.linspace(0.0, np.pi, 60)
    up = np.column_stack([np.full(60, 0.5), np.linspace(-straight / 2.0, straight / 2.0, 60)])
    arc = np.column_stack([0.5 + gap_m / 2.0 * (1.0 - np.cos(turn)), straight / 2.0 + gap_m / 2.0 * np.sin(turn)])
    down = np.column_stack([np.full(60, 0.5 + gap_m), up[::-1, 1]])
    curve = np.concatenate((up, arc[1:], down[1:]))
    return geometry.resample(np.column_stack([curve, np.full(len(curve), 0.004)]), 31)


def test_overlapping_strands_and_a_gap_too_narrow_for_fingers_are_named() -> None:
    (touching,) = overlaps(hairpin(0.006), 0.004)
    assert touching.problem is Problem.LIES_ON_ITSELF
    # Nodes of the two strands are not exactly opposite, so the measured distance is slightly more than the gap.
    assert 0.006 <= touching.amount < 0.008

    (narrow,) = crowded(hairpin(0.02), workplace())
    assert narrow.problem is Problem.NO_ROOM_FOR_FINGERS
    assert crowded(hairpin(0.08), workplace()) == ()


def test_a_goal_of_another_length_is_named_with_the_difference() -> None:
    (finding,) = misfits(1.04 * I_SHAPE, 0.5)
    assert finding.problem is Problem.WRONG_LENGTH
    assert finding.amount == pytest.approx(0.02)
    assert misfits(1.01 * I_SHAPE, 0.5) == ()
