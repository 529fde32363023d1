"""The cell as a component: it advances its time in ticks, publishes its clock, and serves the drivers."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import msgspec
from numpy.typing import ArrayLike

from dlokit.communication import topics
from dlokit.communication.component import Component, holds, implements
from dlokit.communication.timing.urgency import Urgency, never_urgent
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.errors import ClockJumped, MachineError, SkillFailure, SkillRejected
from dlokit.functional.cell import api
from dlokit.functional.cell.arm import CellArm
from dlokit.functional.cell.config import TICK_S, CellConfig
from dlokit.functional.cell.rendering import CameraClock
from dlokit.functional.cell.setpoints import Mirror
from dlokit.functional.cell.truth import TruthRecorder
from dlokit.functional.cell.world import Cell
from dlokit.recording.disk import Disk
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.image import DepthImage, StereoImages
from dlokit.types.robot import FIRST_ROBOT, GripResult, JointTrajectory, MotionResult, RobotMode, RobotReason
from dlokit.types.system import ClockTick

P = TypeVar("P", StereoImages, DepthImage)

_SLIP_LEASE_S = 10.0  # of fingers that a bench moves without their driver; it is not renewed
_SLIP_NS = 100_000_000  # a cell that is further behind than this does not catch up
_MIRROR_SLIP_NS = 400_000_000  # longer, so that the arm moves as the mirrored one; perception refuses older pictures
_MIRROR_LAG_NS = 20_000_000  # behind the clock, so that the states of that time have arrived: two of their periods
MIRROR_CPU_FRACTION = 0.8
"""Fraction of a core above which a mirroring cell loses its real-time priority: it needs 0.3, and more while it catches
up after a picture, when its arm would otherwise leave the mirrored arm's path."""
_MEMORY = 0.98  # weight of the past in the running mean of the pace, per tick


class Pace:
    """Ticks at real time or slower: a cell that cannot keep up runs late instead of catching up at a higher pace."""

    def __init__(self, real_time_factor: float, now_ns: int, slip_ns: int = _SLIP_NS) -> None:
        self._slip_ns = slip_ns
        self._period_ns = round(TICK_S * 1e9 / real_time_factor)
        self._due_ns = now_ns
        self._last_ns = now_ns
        self._mean_ns = float(self._period_ns)

    @property
    def real_time_factor(self) -> float:
        """Recent mean of cell seconds per second of the host's clock."""
        return TICK_S * 1e9 / self._mean_ns

    def next_ns(self, now_ns: int) -> int:
        """When the next tick is due; call once per tick."""
        self._mean_ns = _MEMORY * self._mean_ns + (1.0 - _MEMORY) * (now_ns - self._last_ns)
        self._last_ns = now_ns
        self._due_ns = max(self._due_ns + self._period_ns, now_ns - self._slip_ns)
        return self._due_ns


class Watchdog:
    """Measures silence on the machine's clock, so that a slow cell does not look like a lost commander.

    Time in which the cell itself was busy, e.g. rendering, does not count: of the time between two checks, at most
    `longest_tick_s` does.
    """

    def __init__(self, longest_tick_s: float) -> None:
        self._longest_tick_s = longest_tick_s
        self._lease_s: float | None = None
        self._silence_s = 0.0
        self._looked_s: float | None = None

    def arm(self, lease_s: float | None) -> None:
        """Start measuring silence; None: stop."""
        self._lease_s, self._silence_s, self._looked_s = lease_s, 0.0, None

    def renew(self) -> None:
        """Note a heartbeat of the commander."""
        self._silence_s = 0.0

    def expired(self, now_s: float) -> bool:
        """Whether the silence has lasted longer than the lease; `now_s` is the machine's monotonic clock."""
        if self._lease_s is None:
            return False
        if self._looked_s is not None:
            self._silence_s += min(now_s - self._looked_s, self._longest_tick_s)
        self._looked_s = now_s
        return self._silence_s > self._lease_s


_TICKS_PER_STATE = 2  # arm states at 50 Hz; of a mirroring arm at 100, since its states are the feedback of the twin
_TICK_NS = round(TICK_S * 1e9)
_IN_MOTION = (RobotMode.MOVING, RobotMode.BRAKING)


@dataclass
class _ArmLink:
    """The state of the link to one arm."""

    arm: CellArm
    instance: str
    """Instance of the arm's topics."""
    watchdog: Watchdog = field(default_factory=lambda: Watchdog(longest_tick_s=2 * TICK_S))
    """For the arm's motion."""
    finger_watchdog: Watchdog = field(default_factory=lambda: Watchdog(longest_tick_s=2 * TICK_S))
    interrupted: str = ""
    """Why the running motion was ended early."""
    grip_interrupted: str = ""
    """Why the motion of the fingers was ended early."""
    mirror: Mirror | None = None
    """Receives the states that the arm mirrors; None: it moves by FOLLOW."""


class CellComponent(Component):
    """The simulated reality. In lockstep it follows its host's clock; live, all components follow its clock."""

    name = "cell"
    publishes = (topics.CLOCK, topics.ARM_STATE)
    # Of the arms that its own mirror, in a twin run.
    reads = (topics.ROBOT_STATE,)

    def __init__(
        self,
        config: CellConfig,
        start_world: ArrayLike,
        *,
        seed: int,
        truth_folder: Path | None = None,
        disk: Disk | None = None,
        real_time_factor: float = 1.0,
        arms: tuple[ArmMount, ...] = FIRST_ALONE,
        installation: Installation = PAPERS_CELL,
        urgency: Urgency = never_urgent,
        mirrors: bool = False,
    ) -> None:
        """Build the cell with the DLO at rest along `start_world` (K, 2) or (K, 3) [m].

        The true nodes are noted in `truth_folder` through `disk`. `real_time_factor` is the fastest pace of the cell's
        clock against the host's; in lockstep it must be 1. `urgency` raises the priority while an arm moves: a real arm
        has its own controller, which brakes even if this machine is busy. With `mirrors` the arms follow the states
        that the robots publish, by their stamps: the cell then keeps the pace of its host's clock, always urgent, and
        its arms accept only orders for their fingers. Raises `ShapeError` when the DLO cannot have this shape.
        """
        super().__init__()
        self._cell = Cell(config, seed=seed, arms=arms, installation=installation)
        self._start_world = start_world
        self._cell.place_dlo(start_world)
        self.camera_clock = CameraClock(config.camera_drift_ppm)
        """The clock that stamps the pictures of both cameras. For tests and benches, which make it jump."""
        self._late_ns = round(config.camera_late_s * 1e9)
        self._truth = None if truth_folder is None else TruthRecorder(truth_folder, disk)
        self._factor = real_time_factor
        self._urgency = urgency
        self._mirrors = mirrors
        self._ticks = 0
        self._waiting: list[asyncio.Future[None]] = []
        self._links = {
            mount.robot: _ArmLink(arm=self._cell.arms[mount.robot], instance=mount.instance) for mount in arms
        }
        if mirrors:
            for robot, link in self._links.items():
                link.mirror = self._cell.mirror(robot)

    async def run(self) -> None:
        """Advance time until cancelled."""
        pace = Pace(self._factor, self.port.clock.now_ns(), _MIRROR_SLIP_NS if self._mirrors else _SLIP_NS)
        lag_ns = _MIRROR_LAG_NS if self._mirrors else 0
        self._cell.begin_at(self.port.clock.now_ns() - lag_ns)
        for link in self._links.values():
            if link.mirror is not None:  # outside the loop: the arm moves on while the cell renders
                self.port.tap(topics.ROBOT_STATE.at(link.instance), link.mirror.receive)
        try:
            while True:
                self._publish_tick(pace)
                self._urgency(self._mirrors or any(link.arm.mode in _IN_MOTION for link in self._links.values()))
                due_ns = pace.next_ns(self.port.clock.now_ns())
                await self.port.clock.sleep_until(due_ns)
                self._brake_without_commander()
                if self._mirrors:
                    self._cell.skip(max(due_ns - lag_ns - _TICK_NS - self._cell.time_ns, 0))
                self._cell.step(TICK_S)
                self._ticks += 1
                self._resolve_waiters()
        finally:
            if self._truth is not None:
                self._truth.write()
            self._cell.close()

    def true_nodes_world(self) -> Float64Array:
        """True nodes (Mc, 3) [m]. For the bench's oracle and for tests: no skill returns them."""
        return self._cell.true_nodes_world()

    def view(self) -> UInt8Array:
        """The scene (height, width, 3) for display, without noise. For environments: no skill returns it."""
        return self._cell.camera_view()

    @implements(api.CAPTURE)
    async def capture(self) -> StereoImages:
        """Expose both cameras."""
        return await self._arrived(self._exposed(self._cell.capture))

    @implements(api.CAPTURE_DEPTH)
    async def capture_depth(self) -> DepthImage:
        """Expose the depth camera."""
        return await self._arrived(self._exposed(self._cell.capture_depth))

    @implements(api.FOLLOW)
    async def follow(self, trajectory: JointTrajectory, lease_s: float, robot: str = FIRST_ROBOT) -> MotionResult:
        """Move along a trajectory, under a lease."""
        link = self._idle(robot)
        if link.mirror is not None:
            raise SkillRejected("mirrors", f"the arm {robot} mirrors that of a driver, which alone moves it")
        arm = link.arm
        start_s = self._cell.time_s
        arm.start_follow(trajectory, start_s)
        link.interrupted = ""
        link.watchdog.arm(lease_s)
        try:
            await self._wait_until_at_rest(arm)
        finally:
            link.watchdog.arm(None)
            if arm.mode == RobotMode.MOVING:
                arm.brake(self._cell.time_s)
        if link.interrupted:
            raise SkillFailure(link.interrupted, "the arm braked before the end of the trajectory")
        return MotionResult(
            q_rad=arm.q_rad,
            T_world_tcp=arm.reported_tcp(),
            duration_s=self._cell.time_s - start_s,
            largest_joint_error_rad=arm.largest_error_rad,
        )

    @implements(api.RENEW)
    async def renew(self, robot: str = FIRST_ROBOT) -> None:
        """Renew the leases of the running motions."""
        link = self._link(robot)
        link.watchdog.renew()
        link.finger_watchdog.renew()

    @implements(api.GRIP)
    async def grip(self, width_m: float, force_n: float, lease_s: float, robot: str = FIRST_ROBOT) -> GripResult:
        """Move the fingers, under a lease."""
        refused = self._link(robot).arm.arm_model.gripper.refusal(width_m, force_n)
        if refused is not None:
            raise SkillRejected(*refused)
        link = self._link(robot, to_move=True)
        fingers = link.arm.fingers
        link.grip_interrupted = ""
        link.finger_watchdog.arm(lease_s)
        fingers.start_grip(width_m, force_n)
        try:
            while not fingers.at_rest:
                await self._next_tick()
        finally:
            link.finger_watchdog.arm(None)
            fingers.hold()
        if link.grip_interrupted:
            raise SkillFailure(link.grip_interrupted, "the fingers were held before they came to rest")
        return fingers.result()

    @implements(api.SLIP)
    async def slip(self, width_m: float, for_s: float, force_n: float, robot: str = FIRST_ROBOT) -> None:
        """Open the fingers for a moment."""
        await self.grip(width_m, force_n, _SLIP_LEASE_S, robot)
        until_ns = self._cell.time_ns + round(for_s * 1e9)
        while self._cell.time_ns < until_ns:
            await self._next_tick()
        await self.grip(0.0, force_n, _SLIP_LEASE_S, robot)

    @implements(api.LAY)
    async def lay(self) -> None:
        """Place the DLO in the start shape; it settles as time passes."""
        if any(link.arm.mode in _IN_MOTION for link in self._links.values()):
            raise SkillRejected("arm_moves", "an arm moves; wait until its motion has ended")
        self._cell.place_dlo(self._start_world, settle=False)
        until_ns = self._cell.time_ns + round(self._cell.config.settle_s * 1e9)
        while self._cell.time_ns < until_ns:
            await self._next_tick()

    @implements(api.BRAKE)
    async def brake(self, robot: str = FIRST_ROBOT) -> None:
        """Brake."""
        link = self._link(robot)
        if link.arm.mode == RobotMode.MOVING:
            link.interrupted = RobotReason.STOPPED
            link.arm.brake(self._cell.time_s)
        await self._wait_until_at_rest(link.arm)

    @implements(api.STOP)
    async def stop(self, robot: str = FIRST_ROBOT) -> None:
        """Brake, hold the fingers, and refuse to move."""
        link = self._link(robot)
        if not link.arm.fingers.at_rest:
            link.grip_interrupted = RobotReason.STOPPED
        if link.arm.mode == RobotMode.MOVING:
            link.interrupted = RobotReason.STOPPED
        link.arm.stop(self._cell.time_s)
        await self._wait_until_at_rest(link.arm)

    @implements(api.ENABLE)
    async def enable(self, robot: str = FIRST_ROBOT) -> None:
        """Clear a stop."""
        self._link(robot).arm.enable()

    @implements(api.RECOVER)
    async def recover(self, robot: str = FIRST_ROBOT) -> None:
        """Clear a fault."""
        arm = self._link(robot).arm
        await self._wait_until_at_rest(arm)
        arm.recover()

    @holds(api.DRIVER)
    def _is_driver(self, caller: str, robot: str) -> str | None:
        """Whether no robot process serves the arm, or the caller is that process."""
        link = self._links.get(robot)
        if link is None:
            return None  # the skill names the arms that there are
        driver = self.port.alive(f"robot.{link.instance}" if link.instance else "robot").server
        if driver in ("", caller):  # empty in lockstep, where all components share one process
            return None
        return f"the robot process {driver} drives the arm {robot}; call the skills of robot instead"

    def _exposed(self, take: Callable[[], P]) -> P:
        self._urgency(False)  # rendering takes long; the next tick sets it again
        try:
            return take()
        except MachineError as error:
            raise SkillFailure("no_opengl", str(error)) from error

    async def _arrived(self, images: P) -> P:
        """The pictures after their latency, stamped as the camera's driver would stamp them."""
        exposed_ns = images.stamp_ns
        while self._cell.time_ns < exposed_ns + self._late_ns:
            await self._next_tick()
        try:
            stamp_ns = self.camera_clock.stamped(exposed_ns, exposed_ns + self._late_ns)
        except ClockJumped as error:
            raise SkillFailure(api.CLOCK_JUMPED, str(error)) from error
        return msgspec.structs.replace(images, stamp_ns=stamp_ns)

    def _link(self, robot: str, *, to_move: bool = False) -> "_ArmLink":
        first = next(iter(self._links.values()))
        link = first if robot == FIRST_ROBOT else self._links.get(robot)  # also a renamed first arm
        if link is None:
            raise SkillRejected("no_such_robot", f"{robot}; the cell has {', '.join(self._links)}")
        if to_move and link.arm.stop_latched:
            raise SkillRejected(
                RobotReason.STOP_LATCHED, "a person has stopped the arm; a person must enable it: dlokit enable"
            )
        return link

    def _idle(self, robot: str) -> "_ArmLink":
        link = self._link(robot, to_move=True)
        mode = link.arm.mode
        if mode == RobotMode.FAULT:
            raise SkillRejected(RobotReason.FAULT, "the arm braked on its own; call recover first")
        if mode != RobotMode.IDLE:
            raise SkillRejected("busy", f"the arm is {mode.value}; wait, or call stop")
        return link

    def _brake_without_commander(self) -> None:
        """Brake an arm when the commander of its motion is silent."""
        now_s = asyncio.get_running_loop().time()
        for link in self._links.values():
            if link.watchdog.expired(now_s) and link.arm.mode == RobotMode.MOVING:
                link.interrupted = RobotReason.LOST_COMMANDER
                link.arm.brake(self._cell.time_s, fault=True)
            if link.finger_watchdog.expired(now_s) and not link.arm.fingers.at_rest:
                link.grip_interrupted = RobotReason.LOST_COMMANDER
                link.arm.fingers.hold()

    def _publish_tick(self, pace: Pace) -> None:
        stamp_ns = self._cell.time_ns
        self.port.publish(topics.CLOCK, ClockTick(stamp_ns=stamp_ns, real_time_factor=pace.real_time_factor))
        if self._mirrors or self._ticks % _TICKS_PER_STATE == 0:
            for robot, link in self._links.items():
                self.port.publish(topics.ARM_STATE.at(link.instance), self._cell.arm_state(robot))
        if self._truth is not None:
            self._truth.note(self._cell)

    async def _wait_until_at_rest(self, arm: CellArm) -> None:
        while arm.mode in _IN_MOTION:
            await self._next_tick()

    async def _next_tick(self) -> None:
        waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append(waiter)
        await waiter

    def _resolve_waiters(self) -> None:
        waiting, self._waiting = self._waiting, []
        for waiter in waiting:
            if not waiter.done():
                waiter.set_result(None)
