"""Pairs of grasps: two arms, each on its own side, with simultaneous motions."""

import asyncio

import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import SECOND
from dlokit.description.installation import Installation
from dlokit.description.shapes import builtin_shape
from dlokit.geometry import downward, lifted, rmse_m
from dlokit.motion.arm_distance import Apart
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools, SecondArm
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.types.action import Marks, PairPlace, VelocityProfile
from dlokit.types.dlo import DloState, GoalShape

ARMS = Installation().mounts(2)

MODEL = BelievedDlo()
FIRST, OTHER = (ArmKinematics(PANDA, mount.T_world_base) for mount in ARMS)
APART = Apart(FIRST, OTHER)
SECOND_ARM = SecondArm(
    robot=SECOND, arm=PANDA, reachable=OTHER.reachable, place_m=ARMS[1].place_m, apart_m=APART.of_pair_m
)
SHORT = SearchConfig(rollouts=68, generations=1, finalists=1)
STRAIGHT, S = (builtin_shape(name, MODEL.length_m, MODEL.nodes) for name in ("I", "S"))

OVER_THE_MIDDLE = downward((0.52, 0.0, 0.1), 0.8)


def pair_from_i_to_s() -> PairPlace:
    tools = PlanningTools(reachable=FIRST.reachable, actions=ActionConfig(), model=MODEL, second=SECOND_ARM)
    strategy = RolloutConfig(search=SHORT, pick_place=False, drag=False, lay_down=False).build(tools)
    shape = DloState(stamp_ns=1, nodes_world=STRAIGHT, topology=topology(MODEL))
    goal = GoalShape(stamp_ns=1, nodes_world=S, name="S")

    async def first() -> PairPlace:
        action = await anext(strategy.propose(shape, goal, Marks(invalid_nodes=np.zeros(0, dtype=np.int64))))
        assert isinstance(action, PairPlace)
        return action

    return asyncio.run(first())


@pytest.fixture(scope="module")
def pair() -> PairPlace:
    return pair_from_i_to_s()


def test_a_pair_of_grasps_brings_a_straight_rod_near_an_s_in_one_action(pair: PairPlace) -> None:
    assert pair.predicted_nodes_world is not None
    # The two bends of an S need two hands; the best single node leaves 5 cm.
    assert rmse_m(pair.predicted_nodes_world, S) < 0.02


def test_the_arms_of_a_pair_reach_their_poses_and_keep_apart(pair: PairPlace) -> None:
    assert pair.partner is not None
    own = (pair.grasp.T_world_tcp, *pair.path)
    other = (pair.partner.grasp.T_world_tcp, *pair.partner.path)
    assert pair.partner.robot == SECOND
    assert all(map(FIRST.reachable, own))
    assert all(map(OTHER.reachable, other))
    # The arms keep 3 cm apart at waypoints and on the paths from and to home; slightly less in between.
    assert APART.of_pair_m(own, other) > 0.02


@pytest.mark.parametrize("near_at", [0, -1], ids=["on the way there", "on the way home"])
def test_the_paths_from_and_to_home_count_too(near_at: int) -> None:
    # Side by side the tools have 20 cm, but the arms come from opposite sides and each reaches past the other.
    own, other = (
        [downward((x_m, far_m, 0.02), 0.0), downward((x_m, near_m, 0.02), 0.0)][:: 1 if near_at else -1]
        for x_m, near_m, far_m in ((0.60, 0.10, 0.25), (0.44, -0.10, -0.25))
    )
    placed_and_lifted = (
        np.stack([arm.inverse(lifted(poses[near_at], up_m), yaw=Yaw.EITHER) for up_m in (0.0, 0.06)])
        for arm, poses in ((FIRST, own), (OTHER, other))
    )
    assert APART.at_joints_m(*placed_and_lifted) > 0.01
    assert APART.of_pair_m(own, other) < -0.01


def test_arms_at_home_are_far_apart_and_arms_at_one_position_overlap() -> None:
    home = np.array([[0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785398]])
    assert APART.at_joints_m(home, home) > 0.2
    middle = (arm.inverse(OVER_THE_MIDDLE, yaw=Yaw.EITHER)[None] for arm in (FIRST, OTHER))
    assert APART.at_joints_m(*middle) < 0.0


def test_a_partner_that_holds_still_holds_its_end_of_the_rod() -> None:
    pace = VelocityProfile()
    height = PANDA.gripper.grasp_height_m()
    first = np.array([*STRAIGHT[3, :2], height, np.pi / 2])
    last = np.array([*STRAIGHT[-4, :2], height, np.pi / 2])
    aside = first + np.array([0.06, 0.0, 0.0, 0.0])
    held = Motion(
        node=MODEL.nodes - 4, waypoints=np.stack((last, last + np.array([0.0, 0.0, 1e-4, 0.0]))), velocity=pace
    )
    motions = tuple(
        Motion(node=3, waypoints=np.stack((first, aside)), velocity=pace, partner=partner) for partner in (None, held)
    )
    alone, together = simulate(MODEL, STRAIGHT, (PlanningRod(),), motions, 0.005).nodes_world[0]
    np.testing.assert_allclose(together[-4, :2], STRAIGHT[-4, :2], atol=0.004)  # it slides slightly after its release
    assert together[3, 0] - STRAIGHT[3, 0] > 0.04
    assert np.linalg.norm(alone - together, axis=1).max() > 1e-4
