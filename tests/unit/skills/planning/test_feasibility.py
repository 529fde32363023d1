"""Shapes that cannot be worked with are named, with what is wrong and where."""

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.shapes import builtin_shape, moved, random_shape
from dlokit.skills.planning.actions import FeasibilityConfig, GraspConfig
from dlokit.skills.planning.feasibility import check_goal, check_start
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


def of_goal(nodes: Float64Array, camera: CameraCalibration | None = None) -> Verdict:
    return check_goal(nodes, FeasibilityConfig(), GraspConfig(), everywhere, camera)


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
    verdict = check_goal(moved(I_SHAPE, (0.2, 0.0)), FeasibilityConfig(), GraspConfig(), within_70_cm, None)
    assert problems(verdict) == [Problem.OUT_OF_REACH]


def test_a_goal_out_of_view_is_named_and_views_are_not_checked_without_a_camera() -> None:
    far = moved(I_SHAPE, (0.22, 0.0), np.pi / 2)
    wide = FeasibilityConfig(table_x_m=(0.0, 2.0))
    seen = check_goal(far, wide, GraspConfig(), everywhere, LOOKS_DOWN)
    assert problems(seen) == [Problem.OUT_OF_VIEW]
    assert check_goal(far, wide, GraspConfig(), everywhere, None).feasible


def test_a_bend_that_is_too_tight_is_named_for_goals_only() -> None:
    # A right angle of a rod of 31 nodes is still a bend of 10 mm, which a rope of 4 mm takes; a hairpin is not.
    right_angle = np.array([[0.4, -0.2, 0.004], [0.4, 0.0, 0.004], [0.65, 0.0, 0.004]])
    assert of_goal(geometry.resample(right_angle, 31)).feasible
    hairpin = np.array([[0.4, -0.2, 0.004], [0.4, 0.05, 0.004], [0.5, -0.18, 0.004]])
    nodes = geometry.resample(hairpin, 31)
    assert problems(of_goal(nodes)) == [Problem.BENDS_TOO_TIGHTLY]
    assert check_start(nodes, FeasibilityConfig(), GraspConfig(), everywhere, None).feasible


def test_a_rod_across_itself_is_named() -> None:
    t = np.linspace(0.0, 1.0, 200)
    loop = np.column_stack([0.5 + 0.07 * np.sin(4.2 * np.pi * t), 0.1 * (2 * t - 1) + 0.07 * np.cos(4.2 * np.pi * t)])
    nodes = geometry.resample(np.column_stack([loop, np.full(200, 0.004)]), 31)
    verdict = check_start(nodes, FeasibilityConfig(), GraspConfig(), everywhere, None)
    assert Problem.CROSSES_ITSELF in problems(verdict)
    assert "lies across itself" in verdict.text
