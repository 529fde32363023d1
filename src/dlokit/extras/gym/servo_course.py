"""The course of `dlokit/ShapeServo-v0`: the agent moves the tool and its fingers, period by period."""

import math
import time
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.decision.attempt import ActionAttempt
from dlokit.decision.convergence import error_m
from dlokit.decision.faults import result_of
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.looking import look
from dlokit.decision.steps import act, goal, hands, perceive
from dlokit.decision.steps.outcomes import Found, Sight
from dlokit.decision.task import Odometer, ShapeTask, Spent
from dlokit.extras.gym.course import StepResult
from dlokit.extras.gym.observations import tool_numbers
from dlokit.extras.gym.stepped_run import SteppedRun
from dlokit.skills.planning.config import ForesightConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.types.action import Grasp, VelocityProfile
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.flow import RunOutcome
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

_PACE = VelocityProfile(speed_m_s=0.5, acceleration_m_s2=1.2, jerk_m_s3=20.0)
"""Velocity profile with which the largest displacement of a half-second period takes about that period."""
_STILL_M = 0.0015
"""The released DLO lies still when it differs by less than this (RMS over nodes) from the look before [m]."""
_NOTHING_M, _NOTHING_RAD = 1e-4, 1e-3  # smaller displacements are ignored
_REST_S = 0.1  # until the arm's state includes the last skill
_HIGHEST_M = 0.4
_MARGIN_M = 0.1  # the tool may leave the usable table by this


@dataclass(frozen=True, kw_only=True)
class ToolMotion:
    """Scales of an action's numbers."""

    period_s: float
    speed_m_s: float
    turn_rad_s: float


class ServoCourse:
    """One step is one period: the fingers open or close, the tool moves, and the camera looks.

    The robot's skills begin and end at rest. A velocity is the mean over the period; a motion that is too fast for the
    joints takes longer.
    """

    def __init__(self, config: RunConfig, job: ShapeJob, motion: ToolMotion, *, held: bool) -> None:
        """Start the components; with `held` the arm grasps the DLO before the first step. Raises `DlokitError`."""
        self._motion, self._begins_held = motion, held
        planning = replace(config.planning, strategy=FarthestConfig(), foresight=ForesightConfig(enabled=False))
        self._config = config = replace(config, planning=planning)
        self.stepped = SteppedRun(config, job)
        self._job = job
        self._task: ShapeTask | None = None
        self.first_world: Float64Array = np.zeros((0, 3))
        """The system's first shape (M, 3) [m], once the episode has begun."""
        self._closed = False
        self._place = np.zeros(4)
        """Commanded place of the tool (4,): x, y, z [m], yaw [rad]."""
        table, arm = planning.feasibility, config.mounts[0].model
        lowest_m = arm.gripper.grasp_height_m(planning.actions.grasp.tip_clearance_m)
        self._low = np.array([table.table_x_m[0] - _MARGIN_M, table.table_y_m[0] - _MARGIN_M, lowest_m, -math.inf])
        self._high = np.array([table.table_x_m[1] + _MARGIN_M, table.table_y_m[1] + _MARGIN_M, _HIGHEST_M, math.inf])

    def begin(self) -> StepResult:
        """Look, set the goal, and move the hand to the node that is farthest from its goal."""
        return self.stepped.run(self._begin())

    def act(self, vector: Float32Array) -> StepResult:
        """Open or close the fingers, move the tool, and look."""
        return self.stepped.run(self._act(np.clip(np.asarray(vector, dtype=np.float64), -1.0, 1.0)))

    async def _begin(self) -> StepResult:
        port, config = self.stepped.system.decision.port, self._config
        task = self._task = ShapeTask(
            port=port,
            config=config.task,
            robots=config.installation.robots[: config.arms],
            stopwatch=time.perf_counter,
            odometer=Odometer(),
            states=port.stream(topics.STATE),
            commands=port.stream(topics.COMMAND),
            recorded=lambda record: None,
            request=self._job.request,
            spent=Spent(started_ns=port.clock.now_ns()),
        )
        try:
            return await self._prepared(task)
        except StepFault as fault:
            return StepResult(rmse_m=math.nan, outcome=RunOutcome.FAILED, reason=str(fault))

    async def _prepared(self, task: ShapeTask) -> StepResult:
        """The steps of the flow up to the first grasp."""
        await perceive.check_camera(task)
        if await perceive.find_dlo(task) is not Sight.SEEN:
            return StepResult(rmse_m=math.nan, outcome=RunOutcome.INFEASIBLE, reason=task.reason or "")
        await goal.set_goal(task)
        if await perceive.track_model(task) is not Sight.SEEN:
            return StepResult(rmse_m=math.nan, outcome=RunOutcome.INFEASIBLE, reason=task.reason or "")
        self.first_world = task.shape.nodes_world
        rmse_m = error_m(task.shape.nodes_world, task.goal)
        if rmse_m < task.config.threshold_m:
            return StepResult(rmse_m=rmse_m, outcome=RunOutcome.CONVERGED)
        if await act.choose_grasp(task) is not Found.FOUND:
            return StepResult(rmse_m=rmse_m, outcome=RunOutcome.INFEASIBLE, reason=task.reason or "")
        await act.approach(task)
        if self._begins_held:
            await act.grasp(task)
            self._closed = True
            hands.publish_gripped(task, held=task.attempt.grasp_ok)
        await task.port.clock.sleep(_REST_S)
        x, y, z, cosine, sine, *_ = (float(number) for number in tool_numbers(self.stepped.system.transport))
        self._place = np.array([x, y, z, math.atan2(sine, cosine)])
        return StepResult(rmse_m=rmse_m)

    async def _act(self, numbers: Float64Array) -> StepResult:
        task = self._task
        assert task is not None, "the episode has begun"
        clock, began_ns = task.port.clock, task.port.clock.now_ns()
        before_world, refused = task.shape.nodes_world, ""
        try:
            await self._set_fingers(task, closed=bool(numbers[4] > 0.0))
            refused = await self._move(task, numbers[:4])
        except StepFault as fault:
            rmse_m = error_m(before_world, task.goal)
            return StepResult(rmse_m=rmse_m, outcome=RunOutcome.FAILED, reason=str(fault), notes=_noted("", 0.0, False))
        await clock.sleep_until(began_ns + round(self._motion.period_s * 1e9))
        seen = await _looked(task)
        rmse_m, holding = error_m(task.shape.nodes_world, task.goal), _state(task).holding
        moved_m = geometry.rmse_m(task.shape.nodes_world, before_world)
        reached = not self._closed and seen and moved_m < _STILL_M and rmse_m < task.config.threshold_m
        return StepResult(
            rmse_m=rmse_m,
            outcome=RunOutcome.CONVERGED if reached else None,
            notes=_noted(refused, (clock.now_ns() - began_ns) / 1e9, holding),
        )

    async def _set_fingers(self, task: ShapeTask, *, closed: bool) -> None:
        """Open or close the fingers if needed, and publish the node that they hold."""
        if closed == self._closed:
            return
        self._closed = closed
        if not closed:
            await hands.open_fingers(task)
            hands.publish_gripped(task, held=False)
            return
        tool = _state(task).T_world_tcp
        away_m = np.linalg.norm(task.shape.nodes_world[:, :2] - tool.position_m[:2], axis=1)
        task.attempt_under_way = _attempt_at(task.attempt, int(np.argmin(away_m)), tool)
        held = (await hands.close_fingers(task)).held
        hands.publish_gripped(task, held=held)

    async def _move(self, task: ShapeTask, velocity: Float64Array) -> str:
        """Move the tool by a velocity (4,) in -1 to 1; returns the reason of a refusal, else an empty text."""
        motion = self._motion
        scale = np.array([*[motion.speed_m_s] * 3, motion.turn_rad_s]) * motion.period_s
        target = np.clip(self._place + velocity * scale, self._low, self._high)
        displacement = np.abs(target - self._place)
        if displacement[:3].max() < _NOTHING_M and displacement[3] < _NOTHING_RAD:
            return ""
        try:
            pose = geometry.downward(target[:3], float(target[3]))
            result_of(robot.MOVE_LINEAR, await task.port.call(robot.MOVE_LINEAR, pose, _PACE))
        except StepFault as fault:
            if fault.kind is not FaultKind.REFUSED:
                raise
            return fault.reason
        self._place = target
        return ""


async def _looked(task: ShapeTask) -> bool:
    """Look once, and return whether the DLO was seen. If not, its last shape stays."""
    try:
        task.state = await look(task)
    except StepFault:
        return False
    return True


def _state(task: ShapeTask) -> RobotState:
    state = task.port.latest(topics.ROBOT_STATE).value
    assert state is not None, "the arm has moved"
    return state


def _attempt_at(attempt: ActionAttempt, node: int, tool: Pose) -> ActionAttempt:
    """An attempt that grasps a node at the tool's position."""
    grasp = Grasp(node=node, T_world_tcp=tool, opening_m=attempt.action.grasp.opening_m)
    return replace(attempt, action=msgspec.structs.replace(attempt.action, grasp=grasp))


def _noted(refused: str, step_s: float, holding: bool) -> dict[str, str | float | bool]:
    return {"refused": refused, "step_s": step_s, "holding": holding}
