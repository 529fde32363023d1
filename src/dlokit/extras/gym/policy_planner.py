"""A policy of `dlokit/Shape-v0` as an action strategy: for `dlokit.shape`, `dlokit.bench.shaping`, and a real cell."""

from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from typing import Any

import msgspec
import numpy as np

from dlokit.extras.gym.grasp_actions import GraspActions
from dlokit.rod import rollout
from dlokit.skills.planning.base import ActionStrategy, PlanningTools
from dlokit.types.action import Action, Marks
from dlokit.types.arrays import Float32Array
from dlokit.types.dlo import DloState, GoalShape

Policy = Callable[[Mapping[str, Any]], Iterable[Float32Array]]
"""From ``nodes`` and ``goal`` (M, 3) [m] to vectors of the action space, the best first."""


class PolicyPlanner:
    """The settings of a planner that asks a policy.

        dlokit.bench.shaping({"learned": PolicyPlanner(policy, env.unwrapped.actions), "rollout": "rollout"})

    Vectors that gripper or arm cannot execute, and marked nodes, are skipped.
    """

    def __init__(self, policy: Policy, actions: GraspActions) -> None:
        """`actions` is the action space of the environment in which the policy was learned."""
        self._policy, self._actions = policy, actions

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """Build the strategy."""
        return _Asking(self._policy, self._actions, tools)


class _Asking:
    def __init__(self, policy: Policy, actions: GraspActions, tools: PlanningTools) -> None:
        self._policy, self._actions, self._tools = policy, actions, tools

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """The feasible actions of the policy, with the shapes that the planning rod predicts."""
        seen = {"nodes": shape.nodes_world.astype(np.float32), "goal": goal.nodes_world.astype(np.float32)}
        tools = self._tools
        for vector in self._policy(seen):
            action = self._actions.decode(vector, shape.nodes_world, tools)
            if isinstance(action, str) or action.grasp.node in marks.invalid_nodes:
                continue
            predicted = await tools.compute(
                rollout.predict, tools.model, shape.nodes_world, action, tools.arm.gripper, tools.scene.posts_world
            )
            yield msgspec.structs.replace(action, stamp_ns=shape.stamp_ns, predicted_nodes_world=predicted)
