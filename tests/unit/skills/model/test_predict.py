"""Predicted actions: the grasped node follows the tool, friction holds the rest."""

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.shapes import builtin_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import predict, settle
from dlokit.types.action import Grasp, PickPlace, Push, VelocityProfile

CONFIG = BelievedDlo()
I_SHAPE = builtin_shape("I", CONFIG.length_m, CONFIG.nodes)
HEIGHT_M = 0.011


def pick(node: int, by_m: tuple[float, float]) -> PickPlace:
    start = np.array([*I_SHAPE[node, :2], HEIGHT_M])
    end, lift = start + np.array([*by_m, 0.0]), np.array([0.0, 0.0, 0.04])
    yaw = np.pi / 2
    return PickPlace(
        stamp_ns=0,
        grasp=Grasp(node=node, T_world_tcp=geometry.downward(start, yaw)),
        path=(
            geometry.downward(start + lift, yaw),
            geometry.downward(end + lift, yaw),
            geometry.downward(end, yaw),
        ),
        velocity=VelocityProfile(),
    )


def test_a_grasped_end_is_moved_to_its_target_and_the_other_stays() -> None:
    nodes = predict(CONFIG, I_SHAPE, pick(28, (0.08, -0.05)), FRANKA_HAND)
    # It springs back a little when it is released.
    assert np.linalg.norm(nodes[28, :2] - (I_SHAPE[28, :2] + (0.08, -0.05))) < 0.012
    # The lifted end pulls at the rest; friction keeps the other end within half a diameter.
    assert np.linalg.norm(nodes[0] - I_SHAPE[0]) < 0.008
    assert nodes[:, 2].max() < 0.008


def test_predictions_repeat_to_the_bit() -> None:
    action = pick(15, (0.05, 0.0))
    assert np.array_equal(predict(CONFIG, I_SHAPE, action, FRANKA_HAND), predict(CONFIG, I_SHAPE, action, FRANKA_HAND))


def test_friction_holds_the_built_in_goals() -> None:
    for name in ("I", "S"):
        shape = builtin_shape(name, CONFIG.length_m, CONFIG.nodes)
        # A goal that springs back by more than a quarter of the threshold could not be reached.
        assert geometry.rmse_m(settle(CONFIG, shape), shape) < 0.003


def test_friction_does_not_hold_a_bend_that_is_too_tight() -> None:
    stiff = BelievedDlo(bending_stiffness_n_m2=1e-3)
    shape = builtin_shape("S", CONFIG.length_m, CONFIG.nodes)
    assert geometry.rmse_m(settle(stiff, shape), shape) > 0.02


@pytest.mark.parametrize(("beside_m", "moved_m"), [(0.03, 0.03), (0.12, 0.0)])
def test_a_push_moves_the_rod_only_where_the_fingers_meet_it(beside_m: float, moved_m: float) -> None:
    here = I_SHAPE[15]
    # The fingers are wide along their y axis, which is along the rod, and move 6 cm towards it.
    way = [geometry.downward((here[0] - x_m, here[1], 0.01), 0.0) for x_m in (beside_m, beside_m - 0.06)]
    push = Push(
        stamp_ns=0,
        grasp=Grasp(node=15, T_world_tcp=way[0], opening_m=0.0),
        path=(way[1],),
        velocity=VelocityProfile(),
    )
    nodes = predict(CONFIG, I_SHAPE, push, FRANKA_HAND)
    # Half the fingers' thickness is at most 1 cm, and the rod rolls on slightly.
    assert nodes[15, 0] - here[0] == pytest.approx(moved_m, abs=0.015 if moved_m else 0.002)
