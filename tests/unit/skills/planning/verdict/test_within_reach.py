"""Lower bound on the distance from a goal to any shape that is on the table, in view and in reach."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.default_cameras import default_calibration
from dlokit.description.shapes import builtin_shape, moved, random_shape
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict.feasibility import HANDLED_FROM_M, Workplace, out_of_bounds
from dlokit.skills.planning.verdict.within_reach import unreachable_rmse_m
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

I_SHAPE = builtin_shape("I", 0.5, 31)
WIDE = FeasibilityConfig(table_x_m=(-2.0, 2.0), table_y_m=(-2.0, 2.0))


def everywhere(T: Pose) -> bool:
    return True


def within_70_cm(T: Pose) -> bool:
    return bool(np.hypot(*T.position_m[:2]) < 0.7)


def workplace(
    config: FeasibilityConfig = WIDE,
    reachable: Callable[[Pose], bool] = everywhere,
    camera: CameraCalibration | None = None,
) -> Workplace:
    return Workplace(BelievedDlo(), config, reachable, camera)


def test_a_goal_inside_has_distance_zero() -> None:
    place = workplace(FeasibilityConfig(), ArmKinematics(PANDA).reachable, default_calibration())
    assert unreachable_rmse_m(I_SHAPE, place) == 0.0


def test_off_the_table_it_is_the_distance_of_the_nodes_to_the_table() -> None:
    table = FeasibilityConfig(table_x_m=(0.0, 1.0), table_y_m=(-0.3, 0.3))
    assert unreachable_rmse_m(moved(I_SHAPE, (0.6, 0.0)), workplace(table)) == pytest.approx(
        0.12
    )  # all of it, from 1.12 m
    at_corner = np.full((31, 3), (1.03, 0.34, 0.004))
    assert unreachable_rmse_m(at_corner, workplace(table)) == pytest.approx(0.05)


def test_out_of_view_it_is_the_distance_to_the_image_margin() -> None:
    place = workplace(camera=default_calibration())
    spot = np.full((31, 3), (0.52, 0.0, 0.004))
    far = moved(spot, (0.0, 0.8))
    away_m = unreachable_rmse_m(far, place)
    assert away_m > 0.0
    assert out_of_bounds(moved(far, (0.0, -0.99 * away_m)), place) != ()  # not even straight back, by less than that
    # The image border is nearly along x there: straight back is hardly farther.
    assert out_of_bounds(moved(far, (0.0, -1.05 * away_m)), place) == ()


def test_out_of_reach_it_is_slightly_less_than_the_distance_back() -> None:
    spot = np.full((31, 3), (0.9, 0.0, 0.004))
    place = workplace(reachable=within_70_cm)
    truly_m = 0.9 - 0.7 - HANDLED_FROM_M
    # Accurate to two half diagonals of a lattice of 2 cm, and one step of it.
    assert truly_m - 0.049 < unreachable_rmse_m(spot, place) <= truly_m


def test_it_is_never_more_than_the_distance_to_a_valid_shape() -> None:
    place = workplace(FeasibilityConfig(), ArmKinematics(PANDA).reachable, default_calibration())
    rng = np.random.default_rng(1000)
    bounds: list[float] = []
    for _ in range(6):
        kept = random_shape(rng, 0.5, 31)
        assert out_of_bounds(kept, place) == ()
        goal = moved(kept, rng.uniform(-0.25, 0.25, size=2), float(rng.uniform(-math.pi, math.pi)))
        bounds.append(unreachable_rmse_m(goal, place))
        assert bounds[-1] <= geometry.rmse_m(goal, kept)
    assert max(bounds) > 0.012  # some of them are far outside
