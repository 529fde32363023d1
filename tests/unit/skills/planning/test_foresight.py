"""Actions that would tangle the rod are skipped."""

import asyncio
from collections.abc import AsyncIterator, Sequence

import msgspec
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.shapes import builtin_shape, self_clearance_m
from dlokit.skills.planning.foresight import CLEARANCE_M, untangled
from dlokit.types.action import Action, Grasp, PickPlace, VelocityProfile
from dlokit.types.arrays import Float64Array

STRAIGHT = builtin_shape("I", 0.5, 31)


def hairpin(gap_m: float) -> Float64Array:
    """A rod folded once, its two halves `gap_m` apart."""
    half = np.linspace(0.0, 0.25 - gap_m / 2, 15)
    out = np.column_stack([half, np.zeros(15), np.full(15, 0.004)])
    back = np.column_stack([half[::-1], np.full(15, gap_m), np.full(15, 0.004)])
    return np.vstack([out, [[half[-1] + gap_m / 2, gap_m / 2, 0.004]], back])


def grasps(nodes: Sequence[int]) -> AsyncIterator[Action]:
    async def propose() -> AsyncIterator[Action]:
        for node in nodes:
            pose = geometry.downward([0.5, 0.0, 0.01], 0.0)
            yield PickPlace(
                stamp_ns=0, grasp=Grasp(node=node, T_world_tcp=pose), path=(pose,), velocity=VelocityProfile()
            )

    return propose()


def chosen(
    nodes: Sequence[int],
    shapes: dict[int, Float64Array],
    goal: Float64Array = STRAIGHT,
    most: int = 8,
) -> tuple[Action | None, list[int]]:
    """The chosen action, and the nodes whose actions were simulated."""
    played: list[int] = []

    async def predict(action: Action) -> Float64Array:
        played.append(action.grasp.node)
        return shapes.get(action.grasp.node, STRAIGHT)

    return asyncio.run(untangled(grasps(nodes), predict, goal, most)), played


def test_the_first_action_without_a_tangle_is_chosen_with_its_prediction() -> None:
    action, played = chosen([7, 20], {})
    assert action is not None
    assert action.grasp.node == 7
    assert played == [7]
    np.testing.assert_array_equal(action.predicted_nodes_world, STRAIGHT)


def test_an_action_that_brings_strands_together_falls_back_to_the_next_best() -> None:
    action, _ = chosen([7, 20], {7: hairpin(0.01)})
    assert action is not None
    assert action.grasp.node == 20


def test_neighbours_of_a_node_that_tangles_are_not_simulated() -> None:
    _, played = chosen([7, 8, 6, 9, 20], {7: hairpin(0.01)})
    assert played == [7, 20]


def test_if_every_action_tangles_the_one_with_the_largest_distance_is_chosen() -> None:
    action, _ = chosen([7, 20, 28], {7: hairpin(0.01), 20: hairpin(0.03), 28: hairpin(0.02)})
    assert action is not None
    assert action.grasp.node == 20


def test_no_more_actions_are_simulated_than_allowed() -> None:
    tangles = {node: hairpin(0.01) for node in range(31)}
    _, played = chosen(range(0, 31, 4), tangles, most=3)
    assert len(played) == 3


def test_a_goal_with_close_strands_lowers_the_required_distance() -> None:
    goal = hairpin(0.03)
    # 2.5 cm is closer than the rule allows, but not closer than 70 % of what the goal itself has.
    assert 0.7 * self_clearance_m(goal) < self_clearance_m(hairpin(0.025)) < CLEARANCE_M
    action, _ = chosen([7, 20], {7: hairpin(0.025)}, goal)
    assert action is not None
    assert action.grasp.node == 7


@pytest.mark.parametrize("nodes", [[], ()])
def test_without_actions_there_is_none(nodes: Sequence[int]) -> None:
    assert chosen(nodes, {}) == (None, [])


def test_an_action_with_a_predicted_shape_is_not_simulated_again() -> None:
    async def propose() -> AsyncIterator[Action]:
        async for action in grasps([7]):
            yield msgspec.structs.replace(action, predicted_nodes_world=hairpin(0.1))

    async def predict(action: Action) -> Float64Array:
        raise AssertionError(action)

    action = asyncio.run(untangled(propose(), predict, STRAIGHT))
    assert action is not None
    np.testing.assert_array_equal(action.predicted_nodes_world, hairpin(0.1))
