"""The planner of an episode: it takes each action from the environment, and keeps the replaced planner as expert."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import ClassVar

from dlokit.rod import rollout
from dlokit.skills.planning.base import ActionStrategy, Loaded, PlanningTools, StrategyConfig
from dlokit.skills.planning.foresight import untangled
from dlokit.types.action import Action, Marks
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape


@dataclass(frozen=True, kw_only=True)
class Question:
    """A question of the flow to its planner."""

    shape: DloState
    goal: GoalShape
    marks: Marks
    tools: PlanningTools


class AskedPlanner:
    """An action strategy, with its settings, whose only proposal is the environment's action.

    The flow waits in `propose` without time passing, since the episode's clock does not advance between two steps.
    """

    name: ClassVar[str] = "asked"

    def __init__(self, expert: StrategyConfig, *, foresight: bool) -> None:
        """`expert` is the planner of a usual run; `foresight`: that run skips actions that tangle the DLO."""
        self._config, self._foresight = expert, foresight
        self._tools: PlanningTools | None = None
        self._expert: ActionStrategy | None = None
        self._answer: asyncio.Future[Action] | None = None
        self._asked = asyncio.Event()
        self.question: Question | None = None
        """The open question; None while an action is executed."""

    def build(self, tools: PlanningTools) -> ActionStrategy:
        """Build the strategy with the present knowledge of planning."""
        self._tools, self._expert = tools, None
        return self

    def load(self) -> None:
        """Load the compiled code of the expert."""
        if isinstance(self._config, Loaded):
            self._config.load()

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Action]:
        """The action that the environment chooses."""
        assert self._tools is not None, "planning has built the strategy"
        self._answer = asyncio.get_running_loop().create_future()
        self.question = Question(shape=shape, goal=goal, marks=marks, tools=self._tools)
        self._asked.set()
        yield await self._answer

    async def asked(self) -> None:
        """Wait until the flow asks for an action."""
        await self._asked.wait()

    def answer(self, action: Action, *, as_expert: bool) -> None:
        """Answer the question. Call it on the episode's loop.

        An expert that predicts learns from its own actions only: it starts over after another action (`as_expert`
        False).
        """
        assert self._answer is not None
        assert self.question is not None, "the flow asks for no action"
        self.question = None
        self._asked.clear()
        if not as_expert:
            self._expert = None
        self._answer.set_result(action)

    async def expert_action(self) -> Action | None:
        """The expert's action in the present state; None if it has no valid action."""
        assert self.question is not None, "the flow asks for no action"
        asked = self.question
        if self._expert is None:
            self._expert = self._config.build(asked.tools)
        actions = self._expert.propose(asked.shape, asked.goal, asked.marks)
        if not self._foresight:
            return await anext(actions, None)

        async def predict(action: Action) -> Float64Array:
            tools, nodes = asked.tools, asked.shape.nodes_world
            return rollout.predict(tools.model, nodes, action, tools.arm.gripper, tools.scene.posts_world)

        return await untangled(actions, predict, asked.goal.nodes_world)
