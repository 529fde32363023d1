"""Planning: selects the node to grasp and its path to the goal."""

import math
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from functools import partial
from typing import ParamSpec, TypeVar

import msgspec
import numpy as np

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.scene import NO_FIXTURES, Scene
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.rod import rollout
from dlokit.rod.believed import BelievedDlo, as_configured, with_belief
from dlokit.skills.planning import api
from dlokit.skills.planning.base import ActionStrategy, PlanningTools, Reachable, SecondArm, StrategyConfig
from dlokit.skills.planning.config import PlanningConfig, from_spec, load
from dlokit.skills.planning.foresight import untangled
from dlokit.skills.planning.pick_place import goal_in_order
from dlokit.skills.planning.room import HandRoom
from dlokit.skills.planning.servoing import HeldRod, advise, foresee
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.skills.planning.verdict.feasibility import Workplace, check_start
from dlokit.skills.planning.verdict.goal_verdict import HoldVerdict, judge
from dlokit.types.action import Action, Candidates, ControlAdvice, ControlForecast, Correction, GraspedNode, Marks
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, DloState, GoalShape
from dlokit.types.feasibility import GoalVerdict, Verdict
from dlokit.types.robot import FIRST_ROBOT
from dlokit.types.system import StrategySpec

P = ParamSpec("P")
R = TypeVar("R")


def _load(strategy: StrategyConfig, room: HandRoom) -> None:
    load(strategy)
    room.held_along(np.array([[0.5, 0.0, 0.3, 0.0], [0.5, 0.1, 0.3, 0.0]]))  # compiled where there are fixtures


AMONG_FIXTURES = "among the fixtures"
"""Begins the clause that says why the arms could not execute the best action."""
_MOST_REFUSED = 12  # actions that the arms cannot execute; the check of one takes 0.2 s


class PlanningComponent(Component):
    """Planning as a component. It receives the arm's kinematics as a function, everything else over the bus."""

    name = "planning"
    publishes = (topics.CANDIDATES, topics.ACTION, topics.GOAL_VERDICT)
    reads = (topics.CAMERA, topics.BELIEF)

    def __init__(
        self,
        config: PlanningConfig,
        reachable: Reachable,
        model: BelievedDlo,
        stopwatch: Callable[[], float] | None = None,
        second: SecondArm | None = None,
        arm: ArmMount = FIRST_ALONE[0],
        scene: Scene = NO_FIXTURES,
        refusal: Callable[[Action], str] | None = None,
    ) -> None:
        """`reachable` is the arm's kinematics; `model` the rod with which actions are simulated.

        `stopwatch` returns the machine's time [s] in a live run; without it only rollouts are limited. `second` is
        the other arm, where there are two; `arm` is the first. `scene` has the believed fixtures. `refusal`
        returns why the arms cannot execute an action among them, or an empty text; None: they are not asked.
        """
        super().__init__()
        self._model = model
        self._config = config
        self._reachable = reachable
        self._robot, self._gripper, self._posts = arm.robot, arm.model.gripper, scene.posts_world
        self._tools = PlanningTools(
            reachable=reachable,
            actions=config.actions,
            arm=arm.model,
            place_m=arm.place_m,
            model=model,
            table=config.feasibility,
            compute=self._compute,
            tell=self._tell,
            stopwatch=stopwatch,
            second=second,
            scene=scene,
        )
        self._refusal = refusal
        self._learnt_from = 0
        self._settings: StrategyConfig = config.strategy
        self._strategy: ActionStrategy = self._settings.build(self._tools)

    def _learn(self) -> None:
        """Plan with what was learnt of the DLO."""
        belief = self.port.latest(topics.BELIEF).value
        if belief is not None and belief.actions > self._learnt_from:
            self._learnt_from = belief.actions
            self._model = with_belief(self._model, belief)
            self._tools = replace(self._tools, model=self._model)
            self._strategy = self._settings.build(self._tools)

    def preparation(self) -> Callable[[], object] | None:
        """Load the compiled code of the rod for goal verdicts, and of the strategy."""
        return partial(_load, self._config.strategy, self._tools.room)

    @implements(api.PROPOSE)
    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks, skip: int = 0) -> Action:
        """The best valid action, after `skip` others."""
        self._learn()
        _require_same_nodes(shape, goal)
        refused: list[str] = []
        proposed = self._strategy.propose(shape, goal, marks)
        action = await self._best(_after(self._executable(proposed, refused), skip), shape, goal)
        if action is None:
            raise SkillFailure(
                "no_valid_grasp",
                f"none of {len(shape.nodes_world)} nodes is left: {len(marks.invalid_nodes)} are marked, {skip} were "
                f"skipped, and at the others the gripper does not fit or the arm does not reach"
                + (f"; {AMONG_FIXTURES} {refused[0]}" if refused else ""),
            )
        if action.robot == FIRST_ROBOT:  # strategies need not know what the installation calls it
            action = msgspec.structs.replace(action, robot=self._robot)
        self.port.publish(topics.ACTION, action)
        return action

    async def _executable(self, actions: AsyncIterator[Action], refused: list[str]) -> AsyncIterator[Action]:
        """The actions whose motions the arms can execute among the fixtures; it ends when too many cannot be.

        The reasons why the others cannot be executed are added to `refused`.
        """
        async for action in actions:
            why = "" if self._refusal is None else await self.port.compute(self._refusal, action)
            if not why:
                yield action
                continue
            refused.append(why)
            if len(refused) == _MOST_REFUSED:
                return

    async def _best(self, actions: AsyncIterator[Action], shape: DloState, goal: GoalShape) -> Action | None:
        if not self._config.foresight.enabled:
            return await anext(actions, None)

        async def predict(action: Action) -> Float64Array:
            return await self.port.compute(
                rollout.predict, self._model, shape.nodes_world, action, self._gripper, self._posts
            )

        return await untangled(actions, predict, goal.nodes_world)

    async def _tell(self, candidates: Candidates) -> None:
        self.port.publish(topics.CANDIDATES, candidates)
        # In lockstep a decision is one long turn of the loop: this lets other components run before it.
        await self.port.clock.sleep(0.0)

    async def _compute(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        # Strategies are built before the port exists.
        return await self.port.compute(function, *args, **kwargs)

    @implements(api.JUDGE_GOAL)
    async def judge_goal(self, goal: GoalShape, threshold_m: float) -> GoalVerdict:
        """Whether a goal can be reached and would hold."""
        self._learn()
        if goal.nodes_world.shape != (self._model.nodes, 3):
            raise SkillRejected(
                "bad_shape",
                f"the goal is {goal.nodes_world.shape} and the model has {self._model.nodes} nodes; "
                f"set the goal through the model, which gives it as many",
            )
        if not (math.isfinite(threshold_m) and threshold_m > 0.0):
            raise SkillRejected("bad_threshold", f"it is {threshold_m}; it must be a number above 0 [m]")

        async def try_goal(nodes_world: Float64Array) -> HoldVerdict:
            return await self.port.compute(
                goal_verdict.try_goal,
                self._model,
                self._belief(),
                nodes_world,
                threshold_m,
                self._config.feasibility,
                self._posts,
            )

        verdict = await judge(goal, threshold_m, place=self._workplace(), try_goal=try_goal)
        self.port.publish(topics.GOAL_VERDICT, verdict)
        return verdict

    @implements(api.CHECK_START)
    async def check_start(self, shape: DloState) -> Verdict:
        """Check that the DLO can be manipulated where it is."""
        return check_start(shape.nodes_world, self._workplace())

    @implements(api.FORESEE_CONTROL)
    async def foresee_control(
        self, shape: DloState, goal: GoalShape, action: Action, prediction_error_m: float = 0.0
    ) -> ControlForecast:
        """Whether control shall follow an action."""
        _require_same_nodes(shape, goal)
        goal_world = goal_in_order(shape.nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
        servo = self._config.servo
        return await self.port.compute(
            foresee, self._model, shape.nodes_world, goal_world, action, prediction_error_m, servo, self._posts
        )

    @implements(api.CORRECT)
    async def correct(
        self,
        shape: DloState,
        goal: GoalShape,
        grip: GraspedNode,
        done: tuple[Correction, ...],
        threshold_m: float,
        others: tuple[GraspedNode, ...] = (),
    ) -> ControlAdvice:
        """The next correction of a held DLO, or the end of control."""
        self._learn()
        _require_same_nodes(shape, goal)
        if not 0 <= grip.node < self._model.nodes or len(shape.nodes_world) != self._model.nodes:
            raise SkillRejected(
                "bad_grip",
                f"node {grip.node} of {len(shape.nodes_world)} is held; the model has {self._model.nodes} nodes",
            )
        goal_world = goal_in_order(shape.nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
        held = HeldRod(shape=shape, goal_world=goal_world, grip=grip, others=others, done=done)
        tools, servo = self._tools, self._config.servo
        return await self.port.compute(
            advise, held, threshold_m, self._model, self._reachable, servo, self._posts, tools.room
        )

    @implements(api.SET_STRATEGY)
    async def set_strategy(self, spec: StrategySpec) -> None:
        """Take another strategy."""
        self._settings = from_spec(spec)
        self._strategy = self._settings.build(self._tools)

    def _belief(self) -> DloBelief:
        """What is believed of the DLO by now."""
        believed = self.port.latest(topics.BELIEF).value
        return as_configured(self._model, self.port.clock.now_ns()) if believed is None else believed

    def _workplace(self) -> Workplace:
        view = self.port.latest(topics.CAMERA).value
        return Workplace(
            dlo=self._model,
            config=self._config.feasibility,
            arm=self._tools.arm,
            place_m=self._tools.place_m,
            tip_clearance_m=self._config.actions.grasp.tip_clearance_m,
            reachable=self._reachable,
            calibration=None if view is None else view.calibration,
            scene=self._tools.scene,
        )


def _require_same_nodes(shape: DloState, goal: GoalShape) -> None:
    if shape.nodes_world.shape != goal.nodes_world.shape:
        raise SkillRejected(
            "shapes_differ",
            f"the shape has {len(shape.nodes_world)} nodes, the goal {len(goal.nodes_world)}; "
            f"set the goal through the model, which gives it as many",
        )


async def _after(actions: AsyncIterator[Action], skip: int) -> AsyncIterator[Action]:
    """All but the first `skip` actions."""
    left = skip
    async for action in actions:
        if left == 0:
            yield action
        else:
            left -= 1
