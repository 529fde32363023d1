"""Skips actions for which the model predicts a tangle.

The farthest-point rule moves one node and drags the rest behind it; sometimes the rest comes to lie across the rod.
A self-crossing rod cannot be resolved in a picture, grasped, or untangled by the same rule, so the model simulates
the action before the robot executes it.
"""

from collections.abc import AsyncIterator, Awaitable, Callable

import msgspec

from dlokit.description.shapes import self_clearance_m
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array

Predict = Callable[[Action], Awaitable[Float64Array]]
"""Predicts the shape (M, 3) [m] after an action."""

CLEARANCE_M = 0.04
"""Required distance between strands after an action, as predicted [m]; neighbours along the rod do not count."""
_GOAL_FRACTION = 0.7  # factor on the clearance of a goal whose own strands are closer
_NODE_STRIDE = 3  # after a tangle the next node tried is at least this far from it: neighbours give the same result
_MOST_PREDICTIONS = 8  # of 0.1 to 0.3 s each


def required_clearance_m(goal_world: Float64Array) -> float:
    """Required distance between strands after an action towards a goal (M, 3) [m]."""
    return min(CLEARANCE_M, _GOAL_FRACTION * self_clearance_m(goal_world))


async def untangled(
    actions: AsyncIterator[Action], predict: Predict, goal_world: Float64Array, most: int = _MOST_PREDICTIONS
) -> Action | None:
    """The first of `actions` that keeps the strands apart, with its predicted shape; None when there are none.

    `goal_world` (M, 3) [m]. An action that has a predicted shape keeps it. If none of the `most` predicted actions
    does, it is the action that keeps them farthest apart.
    """
    required_m = required_clearance_m(goal_world)
    tried: list[tuple[float, Action]] = []
    async for action in actions:
        if any(abs(action.grasp.node - other.grasp.node) < _NODE_STRIDE for _, other in tried):
            continue
        nodes = action.predicted_nodes_world
        if nodes is None:
            nodes = await predict(action)
        clearance_m = self_clearance_m(nodes)
        tried.append((clearance_m, msgspec.structs.replace(action, predicted_nodes_world=nodes)))
        if clearance_m >= required_m or len(tried) == most:
            break
    return max(tried, key=lambda pair: pair[0])[1] if tried else None
