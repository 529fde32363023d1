"""Vectors of the action space, and the actions that they stand for."""

from typing import Any

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError
from dlokit.extras.gym.grasp_actions import BESIDE, POSES, GraspActions, nearest_fraction
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.rod.rollout import waypoints_of
from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.rollout.candidates import PlanningScene, to_action
from dlokit.skills.planning.rollout.carrying import Carrying
from dlokit.skills.planning.rollout.laying import Laying
from dlokit.types.action import Action, Drag, PickPlace
from dlokit.types.arrays import Float64Array

TABLE = FeasibilityConfig()
TOOLS = PlanningTools(reachable=ArmKinematics(PANDA).reachable, actions=ActionConfig())
NODES = builtin_shape("I", 0.5, 31)
GOAL = builtin_shape("S", 0.5, 31)
ROUNDING_M = 1e-5  # single precision of numbers that stand for a metre


def actions(grasp: Any = "node", path: Any = "poses") -> GraspActions:
    return GraspActions(grasp, path, table_x_m=TABLE.table_x_m, table_y_m=TABLE.table_y_m, length_m=0.5)


def proposed(family: str) -> Action:
    """The first action of a kind that the planner considers."""
    scene = PlanningScene(NODES, GOAL, frozenset(), TOOLS)
    families = {
        "lay-down": Laying(scene, from_last=True),
        "carry": Carrying(scene, dragging=False),
        "drag": Carrying(scene, dragging=True),
    }
    made = families[family]
    for numbers in made.first(60, np.random.default_rng(0)):
        candidate = made.make(numbers)
        if candidate is not None:
            return to_action(candidate, 0, GOAL, TOOLS)
    raise AssertionError("the planner finds no such action")


def corners_m(action: Action) -> Float64Array:
    """The path of the tool (200, 3) [m], at equal distances."""
    return geometry.resample(waypoints_of(action)[:, :3], 200)


@pytest.mark.parametrize("grasp", ["node", "place"])
@pytest.mark.parametrize(
    ("family", "path"), [("lay-down", "poses"), ("carry", "poses"), ("drag", "poses"), ("carry", "carry")]
)
def test_an_action_of_the_planner_comes_back_from_its_vector(grasp: str, family: str, path: str) -> None:
    space, action = actions(grasp, path), proposed(family)
    vector = space.encode(action, NODES)
    assert space.space.contains(vector)
    again = space.decode(vector, NODES, TOOLS)
    assert not isinstance(again, str)
    # A place does not say which of the last nodes is meant: a grasp is moved inwards from an end.
    assert abs(again.grasp.node - action.grasp.node) <= (0 if grasp == "node" else 1)
    np.testing.assert_allclose(corners_m(again), corners_m(action), atol=ROUNDING_M)
    turns = [waypoints_of(each)[-1, 3] - waypoints_of(each)[0, 3] for each in (again, action)]
    assert turns[0] == pytest.approx(turns[1], abs=1e-5)
    assert again.velocity.speed_m_s == pytest.approx(action.velocity.speed_m_s, abs=1e-6)
    assert again.velocity.acceleration_m_s2 == action.velocity.acceleration_m_s2


def test_every_vector_stands_for_an_action_or_a_reason() -> None:
    rng, space = np.random.default_rng(0), actions("node", "carry")
    kinds: set[str] = set()
    for _ in range(60):
        action = space.decode(rng.uniform(-1.5, 1.5, 7).astype(np.float32), NODES, TOOLS)
        kinds.add(action if isinstance(action, str) else "done")
    assert kinds == {"done", "out_of_reach"}


def test_a_path_near_the_table_is_a_drag_and_a_higher_one_a_carry() -> None:
    space = actions("node", "carry")
    # node, x, y, turn, lift, bow, speed
    low, high = np.array([0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert isinstance(space.decode(low.astype(np.float32), NODES, TOOLS), Drag)
    assert isinstance(space.decode(high.astype(np.float32), NODES, TOOLS), PickPlace)


def test_a_place_without_the_dlo_is_refused() -> None:
    space = actions("place", "carry")
    assert space.decode(np.full(8, -1.0, dtype=np.float32), NODES, TOOLS) == BESIDE


def test_where_the_gripper_does_not_fit_the_action_is_refused() -> None:
    folded = np.vstack((NODES[:16], NODES[15:0:-1] + np.array([0.012, 0.0, 0.0])))
    middle = np.zeros(7, dtype=np.float32)
    middle[0] = -0.5
    assert actions("node", "carry").decode(middle, folded, TOOLS) == "gripper_does_not_fit"


def test_a_path_with_more_corners_keeps_those_that_matter() -> None:
    start = np.array([0.5, 0.0])
    angle = np.linspace(0.0, np.pi, 40)
    arc = np.column_stack([start[0] + 0.1 * np.sin(angle), 0.1 - 0.1 * np.cos(angle), np.full(40, 0.05)])
    base = proposed("carry")
    poses = tuple(geometry.downward(point, 0.0) for point in arc)
    action = PickPlace(stamp_ns=0, grasp=base.grasp, path=poses, velocity=base.velocity)
    vector = actions().encode(action, NODES)
    decoded = actions()._poses(vector[1:-1].astype(np.float64))  # pyright: ignore[reportPrivateUsage]
    assert len(decoded) == POSES
    np.testing.assert_allclose(decoded[-1, :2], arc[-1, :2], atol=ROUNDING_M)
    # Ten pieces of half a circle of 10 cm: the chords are at most 1.3 mm off the arc, and chosen ones a little more.
    away_m = [abs(np.hypot(x - start[0], y - 0.1) - 0.1) for x, y in decoded[1:, :2]]
    assert max(away_m) < ROUNDING_M


def test_the_nearest_point_lies_between_nodes() -> None:
    share, away_m = nearest_fraction(NODES, np.array([NODES[3, 0] + 0.02, 0.25 * NODES[3, 1] + 0.75 * NODES[4, 1]]))
    assert share == pytest.approx(3.75 / 30, abs=1e-9)
    assert away_m == pytest.approx(0.02, abs=1e-9)


@pytest.mark.parametrize(("grasp", "path"), [("nodes", "carry"), ("node", "curve")])
def test_an_unknown_kind_of_numbers_is_refused(grasp: str, path: str) -> None:
    with pytest.raises(ConfigError, match="allowed are"):
        actions(grasp, path)
