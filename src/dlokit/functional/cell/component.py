"""The cell as a component: it lets its time pass in ticks, tells it, and answers the drivers."""

import asyncio
from dataclasses import dataclass, field
from pathlib import Path

from numpy.typing import ArrayLike

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.timing.urgency import Urgency, never_urgent
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.errors import MachineError, SkillFailure, SkillRejected
from dlokit.functional.cell import api
from dlokit.functional.cell.arm import CellArm
from dlokit.functional.cell.config import TICK_S, CellConfig
from dlokit.functional.cell.setpoints import check_grip, check_trajectory
from dlokit.functional.cell.truth import TruthRecorder
from dlokit.functional.cell.world import Cell
from dlokit.types.arrays import Float64Array
from dlokit.types.image import StereoImages
from dlokit.types.robot import FIRST_ROBOT, GripResult, JointTrajectory, MotionResult, RobotMode, RobotReason
from dlokit.types.system import ClockTick

_SLIP_NS = 100_000_000  # the cell falls that far behind before it gives up catching up
_MEMORY = 0.98  # of the running mean of the pace, a tick


class Pace:
    """Ticks at real time or slower: a cell that cannot keep up falls back instead of racing afterwards."""

    def __init__(self, real_time_factor: float, now_ns: int) -> None:
        self._period_ns = round(TICK_S * 1e9 / real_time_factor)
        self._due_ns = now_ns
        self._last_ns = now_ns
        self._mean_ns = float(self._period_ns)

    @property
    def real_time_factor(self) -> float:
        """Cell seconds a second of the host's clock, lately."""
        return TICK_S * 1e9 / self._mean_ns

    def next_ns(self, now_ns: int) -> int:
        """When the next tick is due; call once a tick."""
        self._mean_ns = _MEMORY * self._mean_ns + (1.0 - _MEMORY) * (now_ns - self._last_ns)
        self._last_ns = now_ns
        self._due_ns = max(self._due_ns + self._period_ns, now_ns - _SLIP_NS)
        return self._due_ns


class Watchdog:
    """Measures silence on the machine's clock, so that a slow cell does not look like a lost commander.

    Time in which the cell itself was busy, rendering say, and could not listen does not count: of the time between
    two looks, at most `longest_tick_s` does.
    """

    def __init__(self, longest_tick_s: float) -> None:
        self._longest_tick_s = longest_tick_s
        self._lease_s: float | None = None
        self._silence_s = 0.0
        self._looked_s: float | None = None

    def arm(self, lease_s: float) -> None:
        """Begin to listen."""
        self._lease_s, self._silence_s, self._looked_s = lease_s, 0.0, None

    def disarm(self) -> None:
        """End listening."""
        self._lease_s = None

    def renew(self) -> None:
        """The commander is there."""
        self._silence_s = 0.0

    def expired(self, now_s: float) -> bool:
        """Whether the silence has lasted longer than the lease; `now_s` is the machine's monotonic clock."""
        if self._lease_s is None:
            return False
        if self._looked_s is not None:
            self._silence_s += min(now_s - self._looked_s, self._longest_tick_s)
        self._looked_s = now_s
        return self._silence_s > self._lease_s


_TICKS_PER_STATE = 2  # arm states at 50 Hz
_IN_MOTION = (RobotMode.MOVING, RobotMode.BRAKING)


@dataclass
class _Line:
    """What is kept of one arm."""

    arm: CellArm
    instance: str
    """Whose topics its states go to."""
    watchdog: Watchdog = field(default_factory=lambda: Watchdog(longest_tick_s=2 * TICK_S))
    """Of the arm's motion."""
    finger_watchdog: Watchdog = field(default_factory=lambda: Watchdog(longest_tick_s=2 * TICK_S))
    interrupted: str = ""
    """Why the motion that runs was ended early."""
    grip_interrupted: str = ""
    """Why the motion of the fingers was ended early."""


class CellComponent(Component):
    """Reality. In lockstep it keeps to the clock of its host; live it is the clock that the others follow."""

    name = "cell"
    publishes = (topics.CLOCK, topics.ARM_STATE)

    def __init__(
        self,
        config: CellConfig,
        start_world: ArrayLike,
        *,
        seed: int,
        truth_folder: Path | None = None,
        real_time_factor: float = 1.0,
        arms: tuple[ArmMount, ...] = FIRST_ALONE,
        urgency: Urgency = never_urgent,
    ) -> None:
        """Build the cell with the DLO at rest along `start_world` (K, 2) or (K, 3) [m].

        `truth_folder` receives `truth.npz`. `real_time_factor` is the fastest pace of the cell's clock against the
        host's; in lockstep it must be 1. `urgency` is asked for while an arm moves: a real one has a control box of its
        own, which brakes however busy this machine is. Raises `ShapeError` when the DLO cannot lie there.
        """
        super().__init__()
        self._cell = Cell(config, seed=seed, arms=arms)
        self._cell.place_dlo(start_world)
        self._truth = TruthRecorder(truth_folder) if truth_folder is not None else None
        self._factor = real_time_factor
        self._urgency = urgency
        self._ticks = 0
        self._waiting: list[asyncio.Future[None]] = []
        self._lines = {mount.robot: _Line(arm=self._cell.arms[mount.robot], instance=mount.instance) for mount in arms}

    async def run(self) -> None:
        """Let time pass until cancelled."""
        pace = Pace(self._factor, self.port.clock.now_ns())
        self._cell.begin_at(self.port.clock.now_ns())
        try:
            while True:
                self._tell(pace)
                self._urgency(any(line.arm.mode in _IN_MOTION for line in self._lines.values()))
                await self.port.clock.sleep_until(pace.next_ns(self.port.clock.now_ns()))
                self._guard()
                self._cell.step(TICK_S)
                self._ticks += 1
                self._wake()
        finally:
            if self._truth is not None:
                self._truth.write()
            self._cell.close()

    def true_nodes_world(self) -> Float64Array:
        """Where the DLO truly is, (Mc, 3) [m]. For the bench's oracle and for tests: no skill tells it."""
        return self._cell.true_nodes_world()

    @implements(api.CAPTURE)
    async def capture(self) -> StereoImages:
        """Expose both cameras."""
        self._urgency(False)  # drawing takes long; the next tick asks anew
        try:
            return self._cell.capture()
        except MachineError as error:
            raise SkillFailure("no_opengl", str(error)) from error

    @implements(api.FOLLOW)
    async def follow(self, trajectory: JointTrajectory, lease_s: float, robot: str = FIRST_ROBOT) -> MotionResult:
        """Move along a trajectory, under a lease."""
        line = self._idle(robot)
        arm = line.arm
        check_trajectory(trajectory, arm.setpoint(self._cell.time_s), arm.limits)
        start_s = self._cell.time_s
        line.interrupted = ""
        line.watchdog.arm(lease_s)
        self._cell.start_follow(trajectory, robot)
        try:
            await self._standing(arm)
        finally:
            line.watchdog.disarm()
            if arm.mode == RobotMode.MOVING:
                self._cell.brake(robot)
        if line.interrupted:
            raise SkillFailure(line.interrupted, "the arm braked before the end of the trajectory")
        state = self._cell.arm_state(robot)
        return MotionResult(
            q_rad=state.q_rad,
            T_world_tcp=state.T_world_tcp,
            duration_s=self._cell.time_s - start_s,
            largest_joint_error_rad=arm.largest_error_rad,
        )

    @implements(api.RENEW)
    async def renew(self, robot: str = FIRST_ROBOT) -> None:
        """Renew the lease of the motions that run."""
        line = self._line(robot)
        line.watchdog.renew()
        line.finger_watchdog.renew()

    @implements(api.GRIP)
    async def grip(self, width_m: float, force_n: float, lease_s: float, robot: str = FIRST_ROBOT) -> GripResult:
        """Move the fingers, under a lease."""
        check_grip(width_m, force_n)
        line = self._enabled(robot)
        fingers = line.arm.fingers
        line.grip_interrupted = ""
        line.finger_watchdog.arm(lease_s)
        self._cell.set_grip(width_m, force_n, robot)
        try:
            while not fingers.at_rest:
                await self._next_tick()
        finally:
            line.finger_watchdog.disarm()
            fingers.hold()
        if line.grip_interrupted:
            raise SkillFailure(line.grip_interrupted, "the fingers were held before they came to rest")
        return fingers.result()

    @implements(api.BRAKE)
    async def brake(self, robot: str = FIRST_ROBOT) -> None:
        """Brake."""
        line = self._line(robot)
        if line.arm.mode == RobotMode.MOVING:
            line.interrupted = RobotReason.STOPPED
            self._cell.brake(robot)
        await self._standing(line.arm)

    @implements(api.STOP)
    async def stop(self, robot: str = FIRST_ROBOT) -> None:
        """Brake, hold the fingers, and refuse to move."""
        line = self._line(robot)
        if not line.arm.fingers.at_rest:
            line.grip_interrupted = RobotReason.STOPPED
        if line.arm.mode == RobotMode.MOVING:
            line.interrupted = RobotReason.STOPPED
        self._cell.stop(robot)
        await self._standing(line.arm)

    @implements(api.ENABLE)
    async def enable(self, robot: str = FIRST_ROBOT) -> None:
        """Clear a stop."""
        self._line(robot).arm.enable()

    @implements(api.RECOVER)
    async def recover(self, robot: str = FIRST_ROBOT) -> None:
        """Clear a fault."""
        arm = self._line(robot).arm
        await self._standing(arm)
        arm.recover()

    def _line(self, robot: str) -> "_Line":
        if robot not in self._lines:
            raise SkillRejected("no_such_robot", f"{robot}; the cell has {', '.join(self._lines)}")
        return self._lines[robot]

    def _enabled(self, robot: str) -> "_Line":
        line = self._line(robot)
        if line.arm.stop_latched:
            raise SkillRejected(
                RobotReason.STOP_LATCHED, "a person has stopped the arm; a person must enable it: dlokit enable"
            )
        return line

    def _idle(self, robot: str) -> "_Line":
        line = self._enabled(robot)
        mode = line.arm.mode
        if mode == RobotMode.FAULT:
            raise SkillRejected(RobotReason.FAULT, "the arm stopped itself; call recover first")
        if mode != RobotMode.IDLE:
            raise SkillRejected("busy", f"the arm is {mode.value}; wait, or call stop")
        return line

    def _guard(self) -> None:
        """Brake an arm when the commander of its motion has fallen silent."""
        now_s = asyncio.get_running_loop().time()
        for robot, line in self._lines.items():
            if line.watchdog.expired(now_s) and line.arm.mode == RobotMode.MOVING:
                line.interrupted = RobotReason.LOST_COMMANDER
                self._cell.brake(robot, fault=True)
            if line.finger_watchdog.expired(now_s) and not line.arm.fingers.at_rest:
                line.grip_interrupted = RobotReason.LOST_COMMANDER
                line.arm.fingers.hold()

    def _tell(self, pace: Pace) -> None:
        stamp_ns = self._cell.time_ns
        self.port.publish(topics.CLOCK, ClockTick(stamp_ns=stamp_ns, real_time_factor=pace.real_time_factor))
        if self._ticks % _TICKS_PER_STATE == 0:
            for robot, line in self._lines.items():
                self.port.publish(topics.ARM_STATE.at(line.instance), self._cell.arm_state(robot))
        if self._truth is not None:
            self._truth.note(self._cell)

    async def _standing(self, arm: CellArm) -> None:
        while arm.mode in _IN_MOTION:
            await self._next_tick()

    async def _next_tick(self) -> None:
        waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append(waiter)
        await waiter

    def _wake(self) -> None:
        waiting, self._waiting = self._waiting, []
        for waiter in waiting:
            if not waiter.done():
                waiter.set_result(None)
