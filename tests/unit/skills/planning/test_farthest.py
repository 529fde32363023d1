"""The farthest node first; marked, unreachable and unfit ones are passed over."""

import asyncio

import numpy as np

from dlokit import geometry
from dlokit.description.shapes import builtin_shape, moved
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.skills.planning.farthest import Farthest, FarthestConfig, FarthestTangentConfig
from dlokit.types.action import Action, Marks
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape, Topology
from dlokit.types.pose import Pose

NODES = 31
I_SHAPE = builtin_shape("I", 0.5, NODES)
TOPOLOGY = Topology(
    edges=np.column_stack((np.arange(NODES - 1), np.arange(1, NODES))), rest_lengths_m=np.full(NODES - 1, 0.5 / 30)
)


def bulged(at: int) -> Float64Array:
    """The I with a smooth bulge, largest at one node."""
    nodes = I_SHAPE.copy()
    nodes[:, 0] += 0.06 * np.exp(-(((np.arange(NODES) - at) / 6.0) ** 2))
    return nodes


def proposals(
    nodes: Float64Array,
    goal: Float64Array,
    marked: tuple[int, ...] = (),
    *,
    unreachable_x_m: float = 9.0,
    ends_interchangeable: bool = False,
) -> list[Action]:
    def reachable(T: Pose) -> bool:
        return float(T.position_m[0]) < unreachable_x_m

    strategy = Farthest(PlanningTools(reachable=reachable, actions=ActionConfig()))
    shape = DloState(stamp_ns=7, nodes_world=nodes, topology=TOPOLOGY)
    wanted = GoalShape(stamp_ns=0, nodes_world=goal, ends_interchangeable=ends_interchangeable)
    marks = Marks(invalid_nodes=np.array(marked, dtype=np.int64))

    async def collect() -> list[Action]:
        return [action async for action in strategy.propose(shape, wanted, marks)]

    return asyncio.run(collect())


def test_the_farthest_node_is_grasped_first_and_the_others_follow() -> None:
    found = [action.grasp.node for action in proposals(bulged(20), I_SHAPE)]
    assert found[0] == 20
    assert set(found[:3]) == {19, 20, 21}
    assert sorted(found) == list(range(NODES))


def test_the_node_is_taken_to_its_goal() -> None:
    action = proposals(bulged(20), I_SHAPE)[0]
    # Arc lengths of bulge and goal differ: equal shares of the length lie some millimetres apart.
    assert np.linalg.norm(action.path[-1].position_m[:2] - I_SHAPE[20, :2]) < 0.008
    assert np.linalg.norm(action.grasp.T_world_tcp.position_m[:2] - bulged(20)[20, :2]) < 0.008
    assert action.velocity.speed_m_s > 0.0
    assert action.stamp_ns == 7


def test_marked_nodes_are_left_out() -> None:
    found = [action.grasp.node for action in proposals(bulged(20), I_SHAPE, (20, 19, 21))]
    assert found[0] in (18, 22)
    assert not {19, 20, 21} & set(found)


def test_an_unreachable_grasp_falls_back_to_the_next_best() -> None:
    found = proposals(bulged(20), I_SHAPE, unreachable_x_m=0.57)
    assert found[0].grasp.node != 20
    assert all(action.grasp.T_world_tcp.position_m[0] < 0.57 for action in found)


def test_nothing_is_proposed_when_nothing_is_in_reach() -> None:
    assert proposals(bulged(20), I_SHAPE, unreachable_x_m=0.0) == []


def test_a_node_whose_gripper_does_not_fit_is_passed_over() -> None:
    nodes = I_SHAPE.copy()
    nodes[15:, 1] = nodes[15, 1] - (nodes[15:, 1] - nodes[15, 1])
    nodes[15:, 0] += 0.016  # folded back upon itself, strands touching
    assert not {3, 27} & {action.grasp.node for action in proposals(nodes, I_SHAPE)}


def test_the_nearer_order_counts_where_ends_are_interchangeable() -> None:
    strict = proposals(bulged(20), I_SHAPE[::-1])
    free = proposals(bulged(20), I_SHAPE[::-1], ends_interchangeable=True)
    assert strict[0].grasp.node in (0, 30)
    assert free[0].grasp.node == 20


def test_the_gripper_turns_to_the_goal_s_tangent() -> None:
    turned = next(action for action in proposals(bulged(20), I_SHAPE) if action.grasp.node == 24)
    assert not np.allclose(turned.path[-1].wxyz, turned.grasp.T_world_tcp.wxyz, atol=1e-3)


def test_with_the_whole_tangent_nodes_are_passed_over_for_which_the_wrist_has_no_room() -> None:
    def narrow(T: Pose) -> bool:
        # Room for half of the turn that the goal asks for, from where the rod lies.
        R = geometry.rotation(T)
        return bool(abs(abs(np.arctan2(R[1, 0], R[0, 0])) - np.pi / 2) < 0.6)

    tools = PlanningTools(reachable=narrow, actions=ActionConfig())
    shape = DloState(stamp_ns=7, nodes_world=I_SHAPE, topology=TOPOLOGY)
    goal = GoalShape(stamp_ns=0, nodes_world=moved(I_SHAPE, (0.0, 0.0), 1.2))
    marks = Marks(invalid_nodes=np.array([], dtype=np.int64))

    async def count(strategy: ActionStrategy) -> int:
        return len([action async for action in strategy.propose(shape, goal, marks)])

    assert asyncio.run(count(FarthestConfig().build(tools))) > 0  # it carries the node without turning it
    assert asyncio.run(count(FarthestTangentConfig().build(tools))) == 0
