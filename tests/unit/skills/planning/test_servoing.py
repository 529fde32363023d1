"""Shape servoing: the Jacobian of releases, its correction by observations, and the verdicts that end control."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.description.scene import NO_POSTS, Box, Scene
from dlokit.geometry import downward, rmse_m
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.skills.planning.room import HandRoom
from dlokit.skills.planning.servoing import (
    LARGEST_M,
    LARGEST_RAD,
    TRUST,
    VELOCITY,
    Grip,
    HeldRod,
    ServoConfig,
    advise,
    corrected,
    damped_step,
    foresee,
    gain,
    jacobian,
    probes,
    released,
    scaled,
)
from dlokit.types.action import ControlVerdict, Correction, Drag, Grasp, GraspedNode, PairPlace, Partner, Push
from dlokit.types.dlo import DloState
from dlokit.types.pose import Pose

MODEL = BelievedDlo()
CONFIG = ServoConfig()
NODES = np.column_stack((np.full(31, 0.5), np.linspace(-0.25, 0.25, 31), np.full(31, MODEL.radius_m)))
HELD = 3
TOOL = np.array([*NODES[HELD, :2], 0.005, np.pi / 2])
GRIP = Grip(HELD, TOOL)


def everywhere(pose: Pose) -> bool:
    return True


def held(goal: np.ndarray, **changes: object) -> HeldRod:
    shape = DloState(stamp_ns=0, nodes_world=NODES, topology=topology(MODEL))
    node = GraspedNode(node=HELD, T_world_tcp=downward(TOOL[:3], float(TOOL[3])))
    base = HeldRod(shape=shape, goal_world=goal, grip=node, others=(), done=())
    return HeldRod(**{**base.__dict__, **changes})  # pyright: ignore[reportArgumentType]


def dragged(by: list[float]) -> np.ndarray:
    """Rest shape of the rod after it is dragged and released."""
    return released(MODEL, NODES, GRIP, [np.array(by)])[0]


def test_control_and_its_forecast_know_the_posts_beside_the_rod() -> None:
    beside = np.array([[0.51, float(NODES[6, 1]), 0.0, 0.51, float(NODES[6, 1]), 0.02, 0.005, 0.3]])
    by = [np.array([0.02, 0.0, 0.0, 0.0])]
    free, stopped = (released(MODEL, NODES, GRIP, by, posts)[0] for posts in (NO_POSTS, beside))
    assert free[6, 0] > 0.505
    assert stopped[6, 0] < 0.503
    alone, among = (advise(held(free), 0.002, MODEL, everywhere, CONFIG, posts) for posts in (NO_POSTS, beside))
    assert alone.then_rmse_m < 0.5 * among.then_rmse_m


def test_the_jacobian_predicts_the_effect_of_a_small_drag_on_the_released_rod() -> None:
    matrix = jacobian(released(MODEL, NODES, GRIP, probes()))
    by = np.array([0.012, 0.0, 0.0, 0.0])
    still, moved = released(MODEL, NODES, GRIP, [np.zeros(4), by])
    said = (matrix @ scaled(by)).reshape(-1, 2)
    # Friction is not smooth; a linear prediction is accurate to a third of the largest displacement.
    assert np.abs(said - (moved - still)[:, :2]).max() < 0.33 * np.abs(moved - still).max()


def test_damped_least_squares_points_to_the_goal_and_keeps_to_the_limits() -> None:
    matrix = jacobian(released(MODEL, NODES, GRIP, probes()))
    error = (dragged([0.01, 0.0, 0.0, 0.0]) - NODES)[:, :2]
    near = damped_step(matrix, error)
    assert near[0] > 0.005
    assert near[2] == 0.0
    far = damped_step(matrix, 30.0 * error)
    assert np.linalg.norm(far[:2]) <= LARGEST_M + 1e-12
    assert abs(far[3]) <= LARGEST_RAD + 1e-12


def test_an_observed_correction_updates_the_jacobian_only_along_it_within_bounds() -> None:
    by = np.array([0.01, 0.0, 0.0, 0.0])
    predicted = NODES + np.array([0.01, 0.0, 0.0])
    done = Correction(displacement=by, released_world=NODES, predicted_world=predicted)
    model = np.zeros((62, 3))
    half_as_far = corrected(model, [done], NODES + 0.75 * (predicted - NODES))
    # Predicted 10 mm, seen 7.5 mm: along x a quarter less than in the model.
    assert half_as_far[::2, 0] == pytest.approx(np.full(31, -0.25))
    assert not half_as_far[:, 1:].any()
    the_other_way = corrected(model, [done], NODES - 5.0 * (predicted - NODES))
    assert np.abs(the_other_way).max() == pytest.approx(TRUST)


def test_a_correction_is_advised_that_is_expected_to_bring_the_shape_nearer() -> None:
    goal = dragged([0.02, 0.01, 0.0, 0.2])
    advice = advise(held(goal), 0.006, MODEL, everywhere, CONFIG)
    assert advice.verdict is ControlVerdict.CORRECT
    assert advice.correction is not None
    assert advice.then_rmse_m < 0.6 * advice.rmse_m
    assert rmse_m(advice.correction.predicted_world, goal) == pytest.approx(advice.then_rmse_m)


def test_a_shape_at_its_goal_is_released() -> None:
    advice = advise(held(dragged([0.0, 0.0, 0.0, 0.0])), 0.006, MODEL, everywhere, CONFIG)
    assert (advice.verdict, advice.reason) == (ControlVerdict.SETTLED, "good_enough")
    assert advice.correction is None


def test_an_error_far_from_the_held_node_is_not_corrected() -> None:
    goal = NODES.copy()
    goal[20:, 0] += 0.05
    advice = advise(held(goal), 0.006, MODEL, everywhere, CONFIG)
    assert (advice.verdict, advice.reason) == (ControlVerdict.SETTLED, "no_gain")


def test_a_rod_that_is_badly_seen_is_not_corrected() -> None:
    shape = msgspec.structs.replace(held(NODES).shape, health=0.3)
    advice = advise(held(dragged([0.02, 0.0, 0.0, 0.0]), shape=shape), 0.006, MODEL, everywhere, CONFIG)
    assert (advice.verdict, advice.reason) == (ControlVerdict.SETTLED, "badly_seen")


UNSURE = {"covariance": np.broadcast_to(0.02**2 * np.eye(3), (31, 3, 3))}
SURE = {"covariance": np.broadcast_to(0.001**2 * np.eye(3), (31, 3, 3))}
HIDDEN = {"visible": np.arange(31) > 15}


@pytest.mark.parametrize(("known", "reason"), [(UNSURE, "in_doubt"), (SURE, ""), (HIDDEN, "in_doubt"), ({}, "")])
def test_a_correction_needs_a_gain_above_the_uncertainty_of_the_shape(known: dict[str, object], reason: str) -> None:
    shape = msgspec.structs.replace(held(NODES).shape, **known)
    assert advise(held(dragged([0.02, 0.0, 0.0, 0.0]), shape=shape), 0.003, MODEL, everywhere, CONFIG).reason == reason


def test_the_uncertainty_of_a_gain_counts_moving_nodes_along_their_motion() -> None:
    error, by = np.full((4, 2), 0.01), np.zeros((4, 2))
    by[0, 0] = 0.01
    seen = np.zeros((4, 2, 2))
    seen[1:], seen[0, 1, 1] = np.eye(2), 1.0
    sure = gain(error, by, seen)
    assert sure.sd_m2 == 0.0
    assert sure.square_m2 == pytest.approx(0.01**2 / 4)
    seen[0, 0, 0] = 0.003**2
    assert gain(error, by, seen).sd_m2 == pytest.approx(2.0 * 0.01 * 0.003 / 4)


def drag(by: list[float]) -> Drag:
    """Node HELD dragged over the table."""
    return Drag(
        stamp_ns=0,
        grasp=Grasp(node=HELD, T_world_tcp=downward(TOOL[:3], float(TOOL[3]))),
        path=(downward(TOOL[:3] + np.array([*by[:2], 0.0]), float(TOOL[3]) + by[3]),),
        velocity=VELOCITY,
    )


def test_control_follows_an_incomplete_action_if_the_observer_is_accurate_enough() -> None:
    action = drag([0.04, 0.02, 0.0, 0.3])
    reached, missed = dragged([0.04, 0.02, 0.0, 0.3]), dragged([0.06, 0.03, 0.0, 0.3])
    assert not foresee(MODEL, NODES, reached, action, 0.0, CONFIG).follows
    assert foresee(MODEL, NODES, missed, action, 0.0, CONFIG).follows
    assert not foresee(MODEL, NODES, missed, action, 0.0, replace(CONFIG, sight_m=0.03)).follows


def test_control_follows_if_such_actions_have_errors_that_the_grasp_can_correct() -> None:
    # All of a stiff rod follows its held node; of a soft one only the neighbours do, and they have no error.
    action, by, stiff = drag([0.04, 0.02, 0.0, 0.3]), np.array([0.04, 0.02, 0.0, 0.3]), 1e-4
    for model, follows in ((replace(MODEL, bending_stiffness_n_m2=stiff), True), (MODEL, False)):
        goal = released(model, NODES, GRIP, [by])[0]
        assert not foresee(model, NODES, goal, action, 0.0, CONFIG).follows
        assert foresee(model, NODES, goal, action, 0.02, CONFIG).follows is follows


def test_control_follows_no_push_and_no_pair() -> None:
    action, goal = drag([0.04, 0.02, 0.0, 0.3]), dragged([0.06, 0.03, 0.0, 0.3])
    assert foresee(MODEL, NODES, goal, action, 0.0, CONFIG).follows
    push = Push(stamp_ns=0, grasp=action.grasp, path=action.path, velocity=action.velocity)
    assert not foresee(MODEL, NODES, goal, push, 0.03, CONFIG).follows
    partner = Partner(robot="second", grasp=action.grasp, path=action.path, velocity=action.velocity)
    pair = PairPlace(stamp_ns=0, grasp=action.grasp, path=action.path, velocity=action.velocity, partner=partner)
    assert not foresee(MODEL, NODES, goal, pair, 0.0, CONFIG).follows


def test_corrections_that_bring_no_progress_are_a_deadlock() -> None:
    goal = dragged([0.02, 0.0, 0.0, 0.0])
    vain = Correction(displacement=np.array([0.02, 0.0, 0.0, 0.0]), released_world=NODES, predicted_world=goal)
    once = advise(held(goal, done=(vain,)), 0.006, MODEL, everywhere, CONFIG)
    assert once.verdict is ControlVerdict.CORRECT
    again = advise(held(goal, done=(vain, vain)), 0.006, MODEL, everywhere, CONFIG)
    assert (again.verdict, again.reason) == (ControlVerdict.DEADLOCK, "no_progress")


def test_a_correction_out_of_reach_is_a_deadlock() -> None:
    advice = advise(held(dragged([0.02, 0.0, 0.0, 0.0])), 0.006, MODEL, lambda pose: False, CONFIG)
    assert (advice.verdict, advice.reason) == (ControlVerdict.DEADLOCK, "out_of_reach")


def test_a_correction_without_room_for_the_hand_is_a_deadlock() -> None:
    x, y = TOOL[:2]
    walls = tuple(
        Box(name=name, position_m=(x + beside_m, y, 0.0), size_m=(0.01, 0.2, 0.03))
        for name, beside_m in (("W", -0.034), ("E", 0.034))
    )
    room = HandRoom(PANDA, Scene(fixtures=walls), MODEL.radius_m)
    advice = advise(held(dragged([0.02, 0.0, 0.0, 0.0])), 0.006, MODEL, everywhere, CONFIG, room=room)
    assert (advice.verdict, advice.reason) == (ControlVerdict.DEADLOCK, "no_room")


def test_a_correction_that_would_stretch_the_rod_between_two_tools_is_a_deadlock() -> None:
    other = GraspedNode(node=20, T_world_tcp=downward(NODES[20] + [0.0, 0.004, 0.0], np.pi / 2))
    advice = advise(held(dragged([0.02, -0.02, 0.0, 0.0]), others=(other,)), 0.006, MODEL, everywhere, CONFIG)
    assert (advice.verdict, advice.reason) == (ControlVerdict.DEADLOCK, "overstretch")
