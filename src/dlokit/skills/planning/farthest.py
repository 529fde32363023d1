"""The paper's strategy: grasp the node that is farthest from its goal and carry it there.

Its only setting is whether it uses nodes that the gripper cannot turn completely to the goal's tangent.
"""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.skills.planning.pick_place import Invalid, goal_in_order, take_to_goal
from dlokit.types.action import Action, Marks
from dlokit.types.dlo import DloState, GoalShape


@dataclass(frozen=True, kw_only=True)
class FarthestConfig:
    """The paper's strategy: carry the node farthest from its goal to it."""

    name: ClassVar[str] = "farthest"

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        return Farthest(tools)


@dataclass(frozen=True, kw_only=True)
class FarthestTangentConfig:
    """As `farthest`, but only with nodes that the gripper can turn completely to the goal's tangent."""

    name: ClassVar[str] = "farthest-tangent"

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """The strategy with these settings."""
        return Farthest(tools, whole_turn=True)


class Farthest:
    """Nodes in the order of their distance to the goal, the farthest first; invalid nodes are skipped (Fig. 6)."""

    def __init__(self, tools: PlanningTools, *, whole_turn: bool = False) -> None:
        self._tools, self._whole_turn = tools, whole_turn

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """Valid actions, the node farthest from its goal first."""
        goal_world = goal_in_order(shape.nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
        distance_m = np.linalg.norm(shape.nodes_world - goal_world, axis=1)
        marked = {int(node) for node in marks.invalid_nodes}
        # A stable sort, so that nodes of equal distance keep the order of the rod on every machine.
        for node in np.argsort(-distance_m, kind="stable"):
            if int(node) in marked:
                continue
            action = take_to_goal(shape, goal_world, int(node), self._tools, whole_turn=self._whole_turn)
            if not isinstance(action, Invalid):
                yield action
