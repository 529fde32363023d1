"""The cell as a component: it lets its time pass in ticks, tells it, and answers the drivers."""

import asyncio
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.errors import MachineError, SkillFailure, SkillRejected
from dlokit.functional.cell import api
from dlokit.functional.cell.checks import check_grip, check_servo, check_trajectory
from dlokit.functional.cell.config import TICK_S, CellConfig
from dlokit.functional.cell.pace import Pace
from dlokit.functional.cell.truth import TruthRecorder
from dlokit.functional.cell.watchdog import Watchdog
from dlokit.functional.cell.world import Cell
from dlokit.types.arrays import Float64Array
from dlokit.types.clock import ClockTick
from dlokit.types.image import StereoImages
from dlokit.types.robot import GripResult, JointTrajectory, MotionResult, RobotMode

_TICKS_PER_STATE = 2  # arm states at 50 Hz
_IN_MOTION = (RobotMode.MOVING, RobotMode.BRAKING)


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
    ) -> None:
        """Build the cell with the DLO at rest along `start_world` (K, 2) or (K, 3) [m].

        `truth_folder` receives `truth.npz`. `real_time_factor` is the fastest pace of the cell's clock against the
        host's; in lockstep it must be 1. Raises `ShapeError` when the DLO cannot lie there.
        """
        super().__init__()
        self._cell = Cell(config, seed=seed)
        self._cell.place_dlo(start_world)
        self._truth = TruthRecorder(truth_folder) if truth_folder is not None else None
        self._factor = real_time_factor
        self._ticks = 0
        self._waiting: list[asyncio.Future[None]] = []
        self._watchdog = Watchdog(longest_tick_s=2 * TICK_S)
        self._interrupted = ""
        """Why the motion that runs was ended early."""

    async def run(self) -> None:
        """Let time pass until cancelled."""
        pace = Pace(self._factor, self.port.clock.now_ns())
        self._cell.begin_at(self.port.clock.now_ns())
        try:
            while True:
                self._tell(pace)
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
        try:
            return self._cell.capture()
        except MachineError as error:
            raise SkillFailure("no_opengl", str(error)) from error

    @implements(api.FOLLOW)
    async def follow(self, trajectory: JointTrajectory, lease_s: float) -> MotionResult:
        """Move along a trajectory, under a lease."""
        self._require_idle()
        arm = self._cell.arm
        check_trajectory(trajectory, arm.setpoint(self._cell.time_s), arm.limits)
        start_s = self._cell.time_s
        self._interrupted = ""
        self._watchdog.arm(lease_s)
        self._cell.start_follow(trajectory)
        try:
            await self._standing()
        finally:
            self._watchdog.disarm()
            if arm.mode == RobotMode.MOVING:
                self._cell.brake()
        if self._interrupted:
            raise SkillFailure(self._interrupted, "the arm braked before the end of the trajectory")
        state = self._cell.arm_state()
        return MotionResult(
            q_rad=state.q_rad,
            T_world_tcp=state.T_world_tcp,
            duration_s=self._cell.time_s - start_s,
            largest_joint_error_rad=arm.largest_error_rad,
        )

    @implements(api.RENEW)
    async def renew(self) -> None:
        """Renew the lease of the motion that runs."""
        self._watchdog.renew()

    @implements(api.SERVO_TO)
    async def servo_to(self, q_rad: Float64Array, dq_rad_s: Float64Array) -> None:
        """Lead the joints."""
        arm = self._cell.arm
        if not arm.led:
            self._require_idle()
        check_servo(q_rad, dq_rad_s, arm.setpoint(self._cell.time_s), arm.limits)
        self._cell.set_servo(np.array(q_rad), np.array(dq_rad_s))

    @implements(api.GRIP)
    async def grip(self, width_m: float, force_n: float) -> GripResult:
        """Move the fingers."""
        check_grip(width_m, force_n)
        self._cell.set_grip(width_m, force_n)
        fingers = self._cell.arm.fingers
        while not fingers.at_rest:
            await self._next_tick()
        return fingers.result()

    @implements(api.STOP)
    async def stop(self) -> None:
        """Brake."""
        if self._cell.arm.mode == RobotMode.MOVING:
            self._interrupted = "stopped"
            self._cell.brake()
        await self._standing()

    @implements(api.RECOVER)
    async def recover(self) -> None:
        """Clear a fault."""
        await self._standing()
        self._cell.arm.recover()

    def _require_idle(self) -> None:
        mode = self._cell.arm.mode
        if mode == RobotMode.FAULT:
            raise SkillRejected("fault", "the arm stopped itself; call recover first")
        if mode != RobotMode.IDLE:
            raise SkillRejected("busy", f"the arm is {mode.value}; wait, or call stop")

    def _guard(self) -> None:
        """Brake when the commander of the motion has fallen silent."""
        if self._watchdog.expired(asyncio.get_running_loop().time()) and self._cell.arm.mode == RobotMode.MOVING:
            self._interrupted = "lost_commander"
            self._cell.brake(fault=True)

    def _tell(self, pace: Pace) -> None:
        stamp_ns = self._cell.time_ns
        self.port.publish(topics.CLOCK, ClockTick(stamp_ns=stamp_ns, real_time_factor=pace.real_time_factor))
        if self._ticks % _TICKS_PER_STATE == 0:
            self.port.publish(topics.ARM_STATE, self._cell.arm_state())
        if self._truth is not None:
            self._truth.note(self._cell)

    async def _standing(self) -> None:
        while self._cell.arm.mode in _IN_MOTION:
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
