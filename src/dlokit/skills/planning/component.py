"""Planning: which node to grasp, and on which path to take it to its goal."""

from collections.abc import AsyncIterator

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.skills.model import rollout
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.planning import api, feasibility
from dlokit.skills.planning.base import ActionStrategy, PlanningTools, Reachable
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.foresight import untangled
from dlokit.skills.planning.strategies import from_spec
from dlokit.types.action import Action, Marks, PickPlace
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.feasibility import Verdict
from dlokit.types.image import CameraCalibration
from dlokit.types.strategy import StrategySpec


class PlanningComponent(Component):
    """Planning as a component. It is told whether the arm reaches a pose; all else is on the bus."""

    name = "planning"
    publishes = (topics.ACTION,)
    reads = (topics.OBSERVATION,)

    def __init__(self, config: PlanningConfig, reachable: Reachable, model: ModelConfig) -> None:
        """`reachable` is the arm's kinematics; `model` the rod that actions are played through with."""
        super().__init__()
        self._model = model
        self._config = config
        self._reachable = reachable
        self._tools = PlanningTools(reachable=reachable, actions=config.actions)
        self._strategy: ActionStrategy = config.strategy.build(self._tools)

    @implements(api.PROPOSE)
    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks, skip: int = 0) -> PickPlace:
        """The best valid action, after `skip` others."""
        if shape.nodes_world.shape != goal.nodes_world.shape:
            raise SkillRejected(
                "shapes_differ",
                f"the shape has {len(shape.nodes_world)} nodes, the goal {len(goal.nodes_world)}; "
                f"set the goal through the model, which gives it as many",
            )
        action = await self._best(_after(self._strategy.propose(shape, goal, marks), skip), shape, goal)
        if action is None:
            raise SkillFailure(
                "no_valid_grasp",
                f"none of {len(shape.nodes_world)} nodes is left: {len(marks.invalid_nodes)} are marked, {skip} were "
                f"skipped, and at the others the gripper does not fit or the arm does not reach",
            )
        self.port.publish(topics.ACTION, action)
        return action

    async def _best(self, actions: AsyncIterator[Action], shape: DloState, goal: GoalShape) -> Action | None:
        if not self._config.foresight.enabled:
            return await anext(actions, None)

        async def predict(action: Action) -> Float64Array:
            return await self.port.compute(rollout.predict, self._model, shape.nodes_world, action)

        return await untangled(actions, predict, goal.nodes_world, self._config.foresight)

    @implements(api.CHECK_GOAL)
    async def check_goal(self, goal: GoalShape) -> Verdict:
        """Whether a goal can be reached and seen."""
        return feasibility.check_goal(
            goal.nodes_world, self._config.feasibility, self._config.actions.grasp, self._reachable, self._camera()
        )

    @implements(api.CHECK_START)
    async def check_start(self, shape: DloState) -> Verdict:
        """Whether the DLO lies where it can be worked with."""
        return feasibility.check_start(
            shape.nodes_world, self._config.feasibility, self._config.actions.grasp, self._reachable, self._camera()
        )

    @implements(api.SET_STRATEGY)
    async def set_strategy(self, spec: StrategySpec) -> None:
        """Take another strategy."""
        self._strategy = from_spec(spec).build(self._tools)

    def _camera(self) -> CameraCalibration | None:
        seen = self.port.latest(topics.OBSERVATION).value
        return None if seen is None else seen.calibration


async def _after(actions: AsyncIterator[Action], skip: int) -> AsyncIterator[Action]:
    """All but the first `skip` actions."""
    left = skip
    async for action in actions:
        if left == 0:
            yield action
        else:
            left -= 1
