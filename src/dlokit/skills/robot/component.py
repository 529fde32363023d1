"""The robot component: plans, checks and runs motions, one at a time, and brakes when its commander is lost."""

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dlokit.communication import topics
from dlokit.communication.component import Component, holds, implements
from dlokit.communication.port import Port
from dlokit.communication.timing.deadlines import DeadlineWatchdog, LoopWatchdog
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.scene import NO_FIXTURES, Fixture, Scene
from dlokit.errors import HardwareError, SkillFailure
from dlokit.functional.robots.base import Robot
from dlokit.motion.arm_distance import check_apart
from dlokit.motion.collisions import COLLISION_STEP_RAD
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.limits import AT_REST_RAD_S, START_RAD
from dlokit.motion.planned_motion import planned
from dlokit.motion.trajectories import joint_move, pose_move, tool_move
from dlokit.skills.robot import api
from dlokit.skills.robot.config import RobotConfig
from dlokit.skills.robot.lease import RobotLease
from dlokit.skills.robot.neighbours import Neighbours
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import (
    LEASE_S,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotMode,
    RobotReason,
    RobotState,
)

R = TypeVar("R")

log = logging.getLogger(__name__)


STATE_RATE_HZ = 50.0
"""Rate at which the robot's state is published [Hz]; equal to the rate of the cell's arm."""
DEVICE_RATE_HZ = 125.0
"""Largest rate for the arm of another driver [Hz]: 100 are left when each wait takes 2 ms longer."""
_CONFIRMED_S = 0.8
"""Longest wait for the feedback that confirms a stop [s]: an arm brakes within 0.3 s from its largest speed."""


StopButton = Callable[
    [Callable[[Callable[[], str]], Awaitable[None]], Callable[[], Awaitable[None]]],
    contextlib.AbstractAsyncContextManager[None],
]
"""A context in which a person can stop and enable the arm, by the two functions that it receives.

The first takes a function that returns which process asked; it is called when the arm brakes already.
"""


def no_button(
    stop: Callable[[Callable[[], str]], Awaitable[None]], enable: Callable[[], Awaitable[None]]
) -> contextlib.AbstractAsyncContextManager[None]:
    """Without a button: in lockstep a person could not press it in time."""
    return contextlib.nullcontext()


def _is_stopped(state: RobotState) -> bool:
    return state.stop_latched and bool(np.max(np.abs(state.dq_rad_s)) < AT_REST_RAD_S)


def load(kinematics: ArmKinematics, fixtures: tuple[Fixture, ...]) -> None:
    """Load all libraries that plan and check a motion, which importing this module does, and the compiled code."""
    check_fixtures_clear(kinematics.arm, kinematics.arm.home_q_rad, 0.0, fixtures)


class RobotComponent(Component):
    """Robot control (paper, Fig. 3): executes trajectories, moves, grasps, and exposes the robot's state."""

    name = "robot"
    publishes = (topics.ROBOT_STATE, topics.PROTECTION)
    # The heartbeats of its commander, and the states of the other arms.
    reads = (topics.HEARTBEAT, topics.ROBOT_STATE)

    def __init__(
        self,
        config: RobotConfig,
        robot: Robot,
        monotonic_ns: Callable[[], int],
        T_world_base: Pose | None = None,
        instance: str = "",
        watch: DeadlineWatchdog | None = None,
        neighbours: tuple[ArmMount, ...] = (),
        button: StopButton = no_button,
        lease: RobotLease | None = None,
        standing: Callable[[], Awaitable[RobotState]] | None = None,
        state_rate_hz: float = STATE_RATE_HZ,
        scene: Scene = NO_FIXTURES,
    ) -> None:
        """`monotonic_ns` is the machine's clock, for leases; it differs from the clock of the port.

        `T_world_base` is the pose of the arm's base; None: the world's origin. `instance` is the address of the arm if
        there are several, and `neighbours` are the other arms; `watch` checks the deadlines of the lease and of the
        other arms' states, by default on the event loop. `button` lets a person stop the arm without the bus. `lease`
        is shared with the robot's gate. `standing` returns a fresh state of the arm at rest, from which motions are
        planned; by default the newest one. New states are polled and published `state_rate_hz` times a second. Arm and
        fingers keep clear of the fixtures of the believed `scene`.
        """
        super().__init__()
        self.instance = instance
        self._config = config
        self._robot = robot
        self._standing = standing or self._newest
        self._state_rate_hz = state_rate_hz
        self._fixtures = scene.fixtures
        self._kinematics = ArmKinematics(robot.arm, T_world_base)
        self._lease = lease or RobotLease(monotonic_ns)
        self._watch = watch or LoopWatchdog()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._motion: asyncio.Task[Any] | None = None
        self._braked_because = ""
        self._latched = False
        self._stopped_by = ""
        self._commanded: NDArray[np.float64] | None = None
        self._others = neighbours
        self._button = button
        self._neighbours: Neighbours | None = None

    def attach(self, port: Port) -> None:
        """Keep the port, and watch the other arms through it."""
        super().attach(port)
        self._neighbours = (
            Neighbours(port, self._robot.arm, self._others, self._config.arm_clearance_m, self._robot.now_ns)
            if self._others
            else None
        )

    def preparation(self) -> Callable[[], object]:
        """Load the libraries that plan and check a motion."""
        return partial(load, self._kinematics, self._fixtures)

    async def run(self) -> None:
        """Publish each new state of the robot once: when the arm is silent, the topic is silent too.

        The driver's protection settings are published each time they are set.
        """
        published_ns, published = -1, None
        self._loop = asyncio.get_running_loop()
        self.port.tap(topics.HEARTBEAT, lambda heartbeat: self._lease.hear(heartbeat.holder))
        try:
            async with self._robot, self._button(self.stop_from_outside, self.enable):
                while True:
                    protection = self._robot.protection()
                    if protection is not None and protection is not published:
                        self.port.publish(topics.PROTECTION, protection)
                        published = protection
                    state = self._robot.state()
                    if state.stamp_ns != published_ns:
                        self.port.publish(topics.ROBOT_STATE, state)
                        published_ns = state.stamp_ns
                        self._keep_apart(state)
                    await self.port.clock.sleep(1.0 / self._state_rate_hz)
        finally:
            self._watch.close()

    def _keep_apart(self, state: RobotState) -> None:
        """Brake when another arm comes too near during a motion."""
        if self._neighbours is None or self._motion is None or self._braked_because:
            return
        why = self._neighbours.too_near(state)
        if why:
            self._brake(RobotReason.ARMS_TOO_NEAR)
            log.warning("braked: %s", why)

    @implements(api.MOVE_JOINTS)
    async def move_joints(self, q_rad: Float64Array) -> MotionResult:
        """Move in joint space."""
        joints = len(self._robot.arm.joints)
        if q_rad.shape != (joints,):
            raise SkillFailure(
                RobotReason.BAD_TRAJECTORY,
                f"q_rad has the shape {q_rad.shape}; give {joints} angles, one of each joint",
            )
        return await self._move(partial(joint_move, end_q_rad=q_rad, limits=self._robot.arm.limits), over=True)

    @implements(api.MOVE_TO)
    async def move_to(self, target: Pose, either_way: bool = True) -> MotionResult:
        """Move in joint space to a tool pose."""
        yaw = Yaw.EITHER if either_way else Yaw.EXACT
        return await self._move(partial(pose_move, self._kinematics, T_world_tcp=target, yaw=yaw), over=True)

    @implements(api.MOVE_LINEAR)
    async def move_linear(self, target: Pose, velocity: VelocityProfile) -> MotionResult:
        """Move the tool on a straight line."""
        return await self._move(partial(tool_move, self._kinematics, poses=(target,), velocity=velocity))

    @implements(api.FOLLOW_PATH)
    async def follow_path(self, path: tuple[Pose, ...], velocity: VelocityProfile) -> MotionResult:
        """Move the tool through poses."""
        return await self._move(partial(tool_move, self._kinematics, poses=path, velocity=velocity))

    @implements(api.GRASP)
    async def grasp(self, force_n: float = api.GRASP_FORCE_N) -> GripResult:
        """Close the fingers."""
        return await self._grip(0.0, force_n)

    @implements(api.RELEASE)
    async def release(self, width_m: float = api.RELEASE_WIDTH_M) -> GripResult:
        """Open the fingers."""
        return await self._grip(width_m, api.GRASP_FORCE_N)

    @implements(api.HOME)
    async def home(self) -> MotionResult:
        """Move out of the camera's view."""
        arm = self._robot.arm
        return await self._move(partial(joint_move, end_q_rad=arm.home_q_rad, limits=arm.limits), over=True)

    @implements(api.HALT)
    async def halt(self) -> None:
        """Brake now."""
        self._brake(RobotReason.STOPPED)
        await self._robot.halt()

    @implements(api.STOP)
    async def stop(self) -> None:
        """Brake now, hold the fingers, and latch."""
        self._latched = True
        self._brake(RobotReason.STOPPED)  # at once; the calls below may have to wait for the driver
        await self._robot.stop()
        await self._confirmed(
            _is_stopped, "the arm is at rest and the stop is latched; press the emergency stop of the arm"
        )

    async def stop_from_outside(self, caller: Callable[[], str]) -> None:
        """Stop for a process that is not on the bus, and name it in the log and in the failure of the motion."""
        self._latched = True
        self._brake(RobotReason.STOPPED)
        try:
            self._stopped_by = caller()
        finally:  # whatever goes wrong with the name must not keep the arm from its stop
            try:
                await self.stop()
            finally:
                log.warning("the arm was stopped by %s", self._stopped_by)  # last: writing a log line may block

    @implements(api.ENABLE)
    async def enable(self) -> None:
        """Clear a stop."""
        await self._robot.enable()
        await self._confirmed(lambda state: not state.stop_latched, "the stop is cleared; try it again")
        self._latched, self._stopped_by = False, ""

    @implements(api.RECOVER)
    async def recover(self) -> None:
        """Clear a fault."""
        await self._robot.recover()

    @implements(api.RENEW_LEASE)
    async def renew_lease(self, holder: str, duration_s: float = LEASE_S) -> None:
        """Take or keep the right to move."""
        self._lease.renew(holder, duration_s)
        self._watch.begin(self._lease, self._lease_expired)

    @implements(api.RELEASE_LEASE)
    async def release_lease(self, holder: str) -> None:
        """Return the right to move."""
        self._lease.release(holder)

    @implements(api.CONFIRM_START)
    async def confirm_start(self) -> None:
        """Allow the holder of the lease to move a real arm."""
        self._lease.confirm()

    def _lease_expired(self) -> None:
        """Brake, from the thread of the watch: the arm stops even when the loop is busy or an order is lost.

        An arm at rest gets no further order: it could arrive late, and stop the next commander's motion.
        """
        moves = self._motion is not None or self._robot.state().mode is RobotMode.MOVING
        if self._braked_because != api.LEASE.reason or moves:
            self._brake(api.LEASE.reason)
        self._lease.noted()

    def _brake(self, reason: str) -> None:
        """Brake now, from any thread, and note why: the running or planned motion fails with this reason."""
        self._braked_because = reason
        self._robot.brake()
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended, and all motions with it
                self._loop.call_soon_threadsafe(self._end_motion)

    def _end_motion(self) -> None:
        if self._motion is not None:
            self._motion.cancel()

    async def _confirmed(self, is_so: Callable[[RobotState], bool], what: str) -> None:
        """Wait for new feedback that fulfils `is_so`; `what` names the missing confirmation and the remedy."""
        now_ns = self._robot.state().stamp_ns
        give_up_ns = self.port.clock.now_ns() + round(_CONFIRMED_S * 1e9)
        while (state := self._robot.state()).stamp_ns <= now_ns or not is_so(state):
            if self.port.clock.now_ns() >= give_up_ns:
                raise SkillFailure(
                    RobotReason.NOT_CONFIRMED, f"no feedback confirmed within {_CONFIRMED_S:g} s that {what}"
                )
            await self.port.clock.sleep(1.0 / STATE_RATE_HZ)

    @holds(api.ENABLED)
    def _is_enabled(self, caller: str) -> str | None:
        """Refuse motions after a person's stop, from any caller."""
        try:
            latched = self._latched or self._robot.state().stop_latched
        except HardwareError:  # not connected yet: the motion itself fails as robot_lost
            latched = self._latched
        if not latched:
            return None
        by = f", by {self._stopped_by}" if self._stopped_by else ""
        return f"a person has stopped this arm{by}; a person must enable it, by dlokit enable or the viewer's button"

    @holds(api.COMMANDER)
    def _is_commander(self, caller: str) -> str | None:
        """Only the holder of the lease may command; without a holder, any caller."""
        if self._lease.holder in ("", caller):
            return None
        return "another process holds this robot's lease; only robot.stop is open to all"

    @holds(api.OWN_NAME)
    def _is_in_own_name(self, caller: str, holder: str) -> str | None:
        """A process takes and returns the lease in its own name only, so that a mistake cannot end another's lease."""
        return None if holder == caller else f"{caller} cannot take or return the lease in the name of {holder}"

    @holds(api.HOLDER)
    def _is_holder(self, caller: str) -> str | None:
        """Only the process that commands the arm may confirm that an operator was asked."""
        if caller == self._lease.holder:
            return None
        return "only the process that holds this robot's lease may confirm the start, after it has asked an operator"

    @holds(api.CONFIRMED)
    def _is_confirmed(self, caller: str) -> str | None:
        """Refuse motions of a real arm before an operator has confirmed the start."""
        if self._lease.confirmed:
            return None
        return (
            "this arm is real, and no operator has confirmed the start: start the run in a terminal and answer its "
            "questions, or with --operator-confirms"
        )

    @holds(api.LEASE)
    def _lease_runs(self, caller: str) -> str | None:
        """Refuse motions while the commander is lost."""
        if not self._lease.lost:
            return None
        return f"{self._lease.holder} has not renewed its lease; renew or release it"

    async def _newest(self) -> RobotState:
        return self._robot.state()

    async def _start(self) -> tuple[NDArray[np.float64], float]:
        """Start of the next motion: the last commanded angles (J,) [rad], or the measured ones if they differ, and the
        distance between the fingertips [m].

        Measured by fresh feedback of the arm at rest: after braking for old feedback, the old state is not valid.
        """
        try:
            standing = await self._standing()
        except HardwareError as error:
            raise SkillFailure(RobotReason.ROBOT_LOST, str(error)) from error
        measured = standing.q_rad
        if self._commanded is not None and np.max(np.abs(self._commanded - measured)) < START_RAD:
            return self._commanded, standing.finger_width_m
        limits = self._robot.arm.limits
        return np.clip(measured, limits.position_lower_rad, limits.position_upper_rad), standing.finger_width_m

    async def _move(self, plan: Callable[[Float64Array], JointTrajectory], *, over: bool = False) -> MotionResult:
        """Plan a motion from the arm's present joint angles (J,) and check it, in one call to the worker; then run it.

        With `over` a motion that fixtures block goes over them.
        """
        self._braked_because = ""
        start, width_m = await self._start()
        trajectory = await self.port.compute(
            planned, self._kinematics, partial(plan, start), self._fixtures, width_m, over=over
        )
        if self._neighbours is not None:
            others = await self._neighbours.now()
            check_apart(self._kinematics, trajectory, others, self._config.arm_clearance_m, COLLISION_STEP_RAD)
            # A silent arm may be anywhere.
            self._watch.begin(
                self._neighbours, lambda: self._brake(self._braked_because or RobotReason.NEIGHBOUR_SILENT)
            )
        self._commanded = None
        try:
            result = await self._run(partial(self._robot.follow, trajectory))
        finally:
            if self._neighbours is not None:
                self._watch.end(self._neighbours)
        self._commanded = trajectory.q_rad[-1].copy()
        return result

    async def _grip(self, width_m: float, force_n: float) -> GripResult:
        self._braked_because = ""
        if self._fixtures and self._robot.arm.gripper.refusal(width_m, force_n) is None:  # else the driver refuses it
            start, now_m = await self._start()
            arm, T_world_base = self._robot.arm, self._kinematics.T_world_base
            await self.port.compute(check_fixtures_clear, arm, start, (now_m, width_m), self._fixtures, T_world_base)
        return await self._run(partial(self._robot.grip, width_m, force_n))

    async def _run(self, order: Callable[[Lease], Coroutine[Any, Any, R]]) -> R:
        """Run an order of the driver; if the arm was braked, the order fails with the reason that `_brake` noted.

        The arm is at rest after a cancelled call.
        """
        if self._braked_because or self._lease.lost:
            raise self._braked("the arm was braked before the motion began")
        lease = Lease(holder=self._lease.holder or self.address, duration_s=self._config.driver_lease_s)
        self._motion = asyncio.create_task(order(lease))
        try:
            return await self._motion
        except asyncio.CancelledError:
            if self._braked_because:
                if self._braked_because != RobotReason.STOPPED:  # `halt` and `stop` wait until the arm is at rest
                    with contextlib.suppress(SkillFailure):  # the arm is gone: the reason of the brake is more useful
                        await self._robot.halt()  # the next motion must find it at rest
                raise self._braked("the arm was braked before the end of the motion") from None
            await self._robot.halt()
            raise
        except SkillFailure as error:
            if self._braked_because:  # the driver failed before the motion was cancelled
                raise self._braked(error.detail) from error
            raise
        except HardwareError as error:
            raise SkillFailure(RobotReason.ROBOT_LOST, str(error)) from error
        finally:
            self._motion = None

    def _braked(self, detail: str) -> SkillFailure:
        """The failure of a motion that a brake has ended; it names the process of a person's stop."""
        match self._braked_because or api.LEASE.reason:
            case RobotReason.STOPPED as reason if self._stopped_by:
                return SkillFailure(reason, f"by {self._stopped_by}: {detail}")
            case reason:
                return SkillFailure(reason, detail)
