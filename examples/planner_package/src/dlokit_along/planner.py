"""A planner that carries the node whose carry brings most of the rod near its goal, by a guess without physics.

The guess: a carried node takes its neighbours along, less the farther they are along the rod.
"""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.skills.planning.pick_place import Invalid, goal_in_order, take_to_goal
from dlokit.types.action import Action, Marks
from dlokit.types.dlo import DloState, GoalShape

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AlongConfig:
    """Settings of the planner that carries the node which takes most of the rod along."""

    name: ClassVar[str] = "along"

    reach_m: float = 0.12
    """Arc length at which a neighbour of a carried node moves 60 % as far [m]; larger for stiffer DLOs."""

    def __post_init__(self) -> None:
        if not self.reach_m > 0.0:
            raise ValueError(f"reach_m is {self.reach_m}; it must be above 0")

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        return Along(self, tools)


class Along:
    """Carries of single nodes to their goals, the one with the least guessed error first."""

    def __init__(self, config: AlongConfig, tools: PlanningTools) -> None:
        self._config, self._tools = config, tools

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """Valid actions, each with the shape that is guessed after it."""
        nodes = shape.nodes_world
        goal_world = goal_in_order(nodes, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
        guessed = carried_along(nodes, goal_world, self._config.reach_m)
        errors_m = np.sqrt(np.mean(np.sum((guessed - goal_world) ** 2, axis=2), axis=1))
        marked = {int(node) for node in marks.invalid_nodes}
        # A stable sort, so that equal errors keep the order of the rod on every machine.
        for node in np.argsort(errors_m, kind="stable"):
            if int(node) in marked:
                continue
            action = take_to_goal(shape, goal_world, int(node), self._tools)
            if not isinstance(action, Invalid):
                yield msgspec.structs.replace(action, predicted_nodes_world=guessed[node])


def carried_along(nodes: Array, goal: Array, reach_m: float) -> Array:
    """The shapes (M, M, 3) [m] after each of the nodes (M, 3) [m] was carried to its goal (M, 3) [m]."""
    edges_m = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    arc_m = np.concatenate([[0.0], np.cumsum(edges_m)])  # (M,)
    weight = np.exp(-0.5 * ((arc_m[:, None] - arc_m) / reach_m) ** 2)  # (carried, moved)
    return nodes + weight[..., None] * (goal - nodes)[:, None]
