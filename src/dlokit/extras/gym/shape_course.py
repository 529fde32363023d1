"""The course of `dlokit/Shape-v0`: the flow of a usual run (Fig. 6), whose planner is the agent."""

import asyncio
from dataclasses import replace

import msgspec
import numpy as np

from dlokit.communication.container import end_tasks
from dlokit.decision.records import ActionRecord, ShapeResult
from dlokit.extras.gym.asked_planner import AskedPlanner
from dlokit.extras.gym.course import StepResult
from dlokit.extras.gym.grasp_actions import GraspActions
from dlokit.extras.gym.stepped_run import SteppedRun
from dlokit.rod import rollout
from dlokit.skills.planning.config import ForesightConfig
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.types.action import Action
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.flow import FlowStatus

_NEVER = 1_000_000
"""Number of actions that no episode reaches: the environment's own budget ends an episode, no stall does."""


class ShapeCourse:
    """One step is one action, from the grasp to the look after the release."""

    def __init__(self, config: RunConfig, job: ShapeJob, actions: GraspActions) -> None:
        """Start the components. Raises `DlokitError`."""
        planning = config.planning
        self._planner = AskedPlanner(planning.strategy, foresight=planning.foresight.enabled)
        self._job, self._actions = job, actions
        config = replace(
            config,
            planning=replace(planning, strategy=self._planner, foresight=ForesightConfig(enabled=False)),
            task=replace(
                config.task,
                max_actions=_NEVER,
                stall_actions=_NEVER,
                watched_stall_actions=_NEVER,
                no_progress_actions=_NEVER,
            ),
        )
        self.stepped = SteppedRun(config, job)
        self._flow: asyncio.Task[ShapeResult] | None = None
        self._records: list[ActionRecord] = []
        self._rmse_m = float("nan")
        self._refused = ""
        self._proposed: Float32Array | None = None

    @property
    def first_world(self) -> Float64Array:
        """The system's first shape (M, 3) [m]."""
        assert self._planner.question is not None, "the flow asks for its first action"
        return self._planner.question.shape.nodes_world

    def begin(self) -> StepResult:
        """Run the flow until it asks for an action."""
        self.stepped.run(self._begin())
        return self._progress()

    def act(self, vector: Float32Array) -> StepResult:
        """Execute one action; an infeasible one is refused, and nothing moves."""
        asked = self._planner.question
        assert asked is not None, "the flow asks for an action"
        self._refused, done = "", len(self._records)
        action = self._actions.decode(vector, asked.shape.nodes_world, asked.tools)
        if isinstance(action, str):
            self._refused = action
            return self._progress(record=None)
        tools = asked.tools
        # The observer needs a prediction of the DLO, as from a planner that predicts.
        action = msgspec.structs.replace(
            action,
            stamp_ns=asked.shape.stamp_ns,
            predicted_nodes_world=rollout.predict(
                tools.model, asked.shape.nodes_world, action, tools.arm.gripper, tools.scene.posts_world
            ),
        )
        as_expert = self._proposed is not None and np.array_equal(self._proposed, vector)
        self.stepped.run(self._execute(action, as_expert=as_expert))
        return self._progress(record=self._records[-1] if len(self._records) > done else None)

    def expert_vector(self) -> Float32Array | None:
        """The configured planner's action in the present state; None without a valid one. Changes nothing."""
        asked = self._planner.question
        assert asked is not None, "the flow asks for an action"
        action = self.stepped.run(self._planner.expert_action())
        self._proposed = None if action is None else self._actions.encode(action, asked.shape.nodes_world)
        return None if self._proposed is None else self._proposed.copy()

    async def _begin(self) -> None:
        flow = self.stepped.system.decision.shape(self._job.request, self._records.append, self._entered)
        self._flow = asyncio.create_task(flow, name="shape_dlo of an environment")
        await self._until_asked()

    async def _execute(self, action: Action, *, as_expert: bool) -> None:
        self._planner.answer(action, as_expert=as_expert)
        await self._until_asked()

    async def _until_asked(self) -> None:
        assert self._flow is not None
        asked = asyncio.create_task(self._planner.asked())
        try:
            await asyncio.wait({asked, self._flow}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            await end_tasks(asked)

    def _entered(self, status: FlowStatus) -> None:
        if status.rmse_m is not None:
            self._rmse_m = status.rmse_m
        if status.last_outcome == "refused":
            self._refused = status.text

    def _progress(self, record: ActionRecord | None = None) -> StepResult:
        notes = {"refused": self._refused, **_noted(record)}
        if self._flow is None or not self._flow.done():
            return StepResult(rmse_m=self._rmse_m, notes=notes)
        result = self._flow.result()
        return StepResult(rmse_m=self._rmse_m, outcome=result.outcome, reason=result.reason or "", notes=notes)


def _noted(record: ActionRecord | None) -> dict[str, float | bool]:
    """The values of an action for `info`; a refused action takes no time."""
    if record is None:
        return {"grasp_ok": False, "slipped": False, "robot_time_s": 0.0, "path_length_m": 0.0}
    return {
        "grasp_ok": record.grasp_ok,
        "slipped": record.slipped,
        "robot_time_s": record.robot_time_s,
        "path_length_m": record.path_length_m,
    }
