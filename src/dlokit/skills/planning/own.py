"""A planner of the calling program: any object with `propose`, without a package and an entry point."""

import copy
from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dlokit.errors import BadValue, ConfigError
from dlokit.rod import rollout
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.base import ActionStrategy, Loaded, PlanningTools, StrategyConfig
from dlokit.skills.planning.pick_place import Invalid, goal_in_order, take_to_goal
from dlokit.types.action import Action, ActionBase, Marks
from dlokit.types.arrays import Float64Array, as_numbers
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose


class PlannerTools:
    """What a planner of your own may use."""

    def __init__(self, tools: PlanningTools) -> None:
        """Wrap the tools of dlokit's own planners."""
        self._tools = tools

    @property
    def dlo(self) -> BelievedDlo:
        """The DLO as the system believes it to be: length, radius, nodes, stiffness, friction."""
        return self._tools.model

    def reachable(self, T_world_tcp: Pose) -> bool:
        """Whether the arm can bring its tool to a pose within its joint limits."""
        return self._tools.reachable(T_world_tcp)

    def pick_and_place(self, shape: DloState, goal: GoalShape | ArrayLike, node: int) -> Action | None:
        """The action that carries `node` to its position in the goal; None if the gripper does not fit or reach.

        `goal` is the goal, or nodes (M, 3) [m] in the order of `shape`, as of a shape on the way to the goal. Raises
        `BadValue` for an array of another form.
        """
        if isinstance(goal, GoalShape):
            goal_world = goal_in_order(
                shape.nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable
            )
        else:
            goal_world = as_numbers(goal, "the goal of pick_and_place")
            if goal_world.shape != shape.nodes_world.shape or not np.isfinite(goal_world).all():
                raise BadValue(
                    f"the goal of pick_and_place has the shape {goal_world.shape}; give the goal, or finite nodes "
                    f"{shape.nodes_world.shape} [m] in the order of the shape."
                )
        action = take_to_goal(shape, goal_world, node, self._tools)
        return None if isinstance(action, Invalid) else action

    async def predict(self, shape: DloState, action: Action) -> Float64Array:
        """The nodes (M, 3) [m] after an action, by the planning rod; takes some milliseconds."""
        tools = self._tools
        return await tools.compute(
            rollout.predict, tools.model, shape.nodes_world, action, tools.arm.gripper, tools.scene.posts_world
        )


class OwnPlanner(Protocol):
    """What a planner of your own is."""

    def propose(
        self, shape: DloState, goal: GoalShape, marks: Marks, tools: PlannerTools
    ) -> AsyncIterator[Action] | Iterable[Action]:
        """Actions, best first, as a generator, an async generator or a list.

        `shape.nodes_world` and `goal.nodes_world` are (M, 3) [m]. The nodes in `marks.invalid_nodes` were tried without
        effect; do not propose them.
        """
        ...


def own_planner(called: str, planner: Any) -> type[StrategyConfig]:
    """The settings class under which an object is known as the planner `called`.

    The object is an `OwnPlanner`, or the settings of a strategy, e.g. ``RolloutConfig(...)``. It is copied, so that
    each run begins with the state that it has now. Raises `ConfigError` where it is neither.
    """
    if isinstance(planner, type) or not (hasattr(planner, "propose") or hasattr(planner, "build")):
        raise ConfigError(
            f"planner {called!r} is {planner!r}; give an object with propose(shape, goal, marks, tools), the settings "
            "of a planner, or the name of one that is installed."
        )
    own = copy.deepcopy(planner)

    @dataclass(frozen=True, kw_only=True)
    class OwnPlannerConfig:
        """A planner of the calling program."""

        name: ClassVar[str] = called

        def build(self, tools: PlanningTools) -> ActionStrategy:
            """The object as a strategy."""
            return own.build(tools) if hasattr(own, "build") else _Adapted(called, own, PlannerTools(tools))

        def load(self) -> None:
            """Load its compiled code, where it has a method for that."""
            if isinstance(own, Loaded):
                own.load()

    return OwnPlannerConfig


class _Adapted:
    """An `OwnPlanner` behind the protocol of strategies."""

    def __init__(self, called: str, planner: OwnPlanner, tools: PlannerTools) -> None:
        self._called, self._planner, self._tools = called, planner, tools

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        proposed = self._planner.propose(shape, goal, marks, self._tools)
        if isinstance(proposed, AsyncIterator):
            async for action in proposed:
                yield self._checked(action)
        else:
            for action in proposed:
                yield self._checked(action)

    def _checked(self, action: Any) -> Action:
        if not isinstance(action, ActionBase):
            raise TypeError(
                f"planner {self._called!r} proposed {action!r}; propose actions, e.g. those of tools.pick_and_place, "
                "which gives None for a node that cannot be grasped"
            )
        return action  # pyright: ignore[reportReturnType]  # the base class of every action
