"""The driver: dlokit's robot protocol on one side, the controller of the arm on the other.

It plans and checks nothing: dlokit's gate has checked every trajectory before `follow` is called.
"""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np

from dlokit import geometry
from dlokit.communication.port import Port
from dlokit.communication.timing.pulse import Pulse
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import ConfigError, HardwareError, SkillFailure
from dlokit.functional.robots.base import Robot
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.types.robot import (
    ArmProtection,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotMode,
    RobotReason,
    RobotState,
)
from dlokit_lab_arm.link import Link

POLL_S = 0.004
CONFIRMED_S = 2.0
"""Longest wait for a controller that must confirm an order [s]."""
HELD_M = 0.002
"""Fingers that stop this far from the ordered width hold something [m]."""


@dataclass(frozen=True, kw_only=True)
class LabArmConfig:
    """The arm of our laboratory; a template of a driver, with a simulated controller."""

    name: ClassVar[str] = "lab-arm"
    in_cell: ClassVar[bool] = False
    is_real: ClassVar[bool] = True  # a run asks the operator before it moves

    address: str = "127.0.0.1"
    """Network address of the controller."""
    port: int = 7501
    """Port of the controller."""

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        """The driver, not connected yet."""
        if mount.instance:
            raise ConfigError(f"--driver {self.name} has one address and moves one arm: leave --arms at 1.")
        return LabArm(self, mount, pulse)


class LabArm:
    """The arm and its gripper."""

    def __init__(self, config: LabArmConfig, mount: ArmMount, pulse: Pulse) -> None:
        self._config, self._mount, self._pulse = config, mount, pulse
        self._link: Link | None = None
        self._motion = self._grip = 0  # numbers of the newest orders, which the controller repeats in its states
        self._held = False

    @property
    def arm(self) -> ArmModel:
        """The model that `--arm` or the installation names."""
        return self._mount.model

    async def __aenter__(self) -> Self:
        """Connect. Raises `HardwareError`."""
        self._link = await self._connected()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Brake, wait for rest, and disconnect; a latched stop stays in the controller."""
        self.brake()
        await self._becomes(lambda: self._lost or self._said["phase"] == "idle")
        self._connection.close()
        self._link = None

    async def _connected(self) -> Link:
        where = f"{self._config.address}:{self._config.port}"
        try:
            link = await asyncio.to_thread(Link, self._config.address, self._config.port)
        except OSError as error:
            raise HardwareError(f"the controller at {where} does not answer: {error}; is it switched on?") from error
        joints, wanted = len(link.newest[0]["q"]), len(self.arm.home_q_rad)
        if joints != wanted:
            link.close()
            raise HardwareError(
                f"the arm at {where} has {joints} joints, {self.arm.title} has {wanted}; give its --arm"
            )
        self._motion, self._grip = link.newest[0]["motion"], link.newest[0]["grip"]
        return link

    @property
    def _connection(self) -> Link:
        if self._link is None:
            raise HardwareError("the arm is not connected; enter the driver first")
        return self._link

    @property
    def _said(self) -> dict[str, Any]:
        return self._connection.newest[0]

    @property
    def _fingers_move(self) -> bool:
        return self._said["width_m"] != self._said["wanted_m"]

    @property
    def _lost(self) -> bool:
        return self._connection.is_lost

    def state(self) -> RobotState:
        """The newest state; the last one, with the mode fault, after the connection was lost."""
        said, stamp_ns = self._connection.newest
        q_rad, base = np.array(said["q"]), self._mount.T_world_base
        tool = tcp_pose(self.arm, q_rad)
        return RobotState(
            stamp_ns=stamp_ns,
            robot=self._mount.robot,
            q_rad=q_rad,
            dq_rad_s=np.array(said["dq"]),
            tau_nm=np.zeros_like(q_rad),  # your arm may measure them
            T_world_tcp=tool if base is None else geometry.compose(base, tool),
            finger_width_m=said["width_m"],
            mode=RobotMode.FAULT if self._lost else RobotMode(said["phase"]),
            holding=self._held,
            T_world_base=base,
            stop_latched=said["latched"],
        )

    def now_ns(self) -> int:
        """The machine's monotonic clock: states are stamped by it when they arrive."""
        return time.monotonic_ns()

    def newest_ns(self) -> int:
        """When the newest state arrived."""
        return self._connection.newest[1]

    def protection(self) -> ArmProtection | None:
        """None: this arm has no thresholds that the driver sets."""
        return None

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory. The controller brakes by itself when no heartbeat comes for `lease.duration_s`."""
        self._check_ready()
        self._motion += 1
        samples = {"times": trajectory.times_s.tolist(), "q": trajectory.q_rad.tolist()}
        began_ns = time.monotonic_ns()
        self._connection.send("follow", id=self._motion, lease_s=lease.duration_s, **samples)
        try:
            async with self._pulse(lambda: self._connection.send("beat"), lease.heartbeat_s):
                await self._until(lambda: self._said["motion"] == self._motion and self._said["ended"] != "")
        except asyncio.CancelledError:
            self.brake()
            raise
        self._check_arrived()
        state = self.state()
        return MotionResult(
            q_rad=state.q_rad,
            T_world_tcp=state.T_world_tcp,
            duration_s=(time.monotonic_ns() - began_ns) / 1e9,
            largest_joint_error_rad=float(self._said["error_rad"]),
        )

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Move the fingers to a width; the controller holds them when no heartbeat comes."""
        self._check_ready()
        self._held = False
        self._grip += 1
        self._connection.send("grip", id=self._grip, width_m=width_m, force_n=force_n, lease_s=lease.duration_s)
        try:
            async with self._pulse(lambda: self._connection.send("beat"), lease.heartbeat_s):
                await self._until(lambda: self._said["grip"] == self._grip and not self._fingers_move)
        except asyncio.CancelledError:
            self._connection.send("hold")
            raise
        self._check_not_latched(RobotReason.STOPPED)
        if self._said["wanted_m"] != width_m:
            raise SkillFailure(RobotReason.LOST_COMMANDER, "no heartbeat of the driver came in time; the fingers hold")
        state = self.state()
        self._held = state.finger_width_m - width_m > HELD_M
        return GripResult(width_m=state.finger_width_m, held=self._held)

    async def halt(self) -> None:
        """Brake; returns at rest."""
        self.brake()
        await self._confirmed(lambda: self._said["phase"] == "idle", "the arm is not at rest")

    async def stop(self) -> None:
        """Brake and latch; returns at rest. The controller keeps the latch."""
        self._connection.send("stop")
        await self._confirmed(
            lambda: self._said["latched"] is True and self._said["phase"] == "idle", "the stop is not confirmed"
        )

    async def enable(self) -> None:
        """Clear a stop."""
        self._connection.send("enable")
        await self._confirmed(lambda: self._said["latched"] is False, "the arm is not enabled")

    def brake(self) -> None:
        """Order the arm to brake; from any thread."""
        self._connection.send("brake")

    async def recover(self) -> None:
        """Connect again after a lost connection; a stop stays."""
        if self._lost:
            self._link = await self._connected()

    async def _becomes(self, is_so: Callable[[], bool]) -> bool:
        deadline_s = time.monotonic() + CONFIRMED_S
        while not is_so():
            if time.monotonic() > deadline_s:
                return False
            await asyncio.sleep(POLL_S)
        return True

    async def _confirmed(self, is_so: Callable[[], bool], otherwise: str) -> None:
        if not await self._becomes(is_so):
            raise SkillFailure(RobotReason.NOT_CONFIRMED, f"{otherwise} after {CONFIRMED_S:g} s")

    async def _until(self, is_so: Callable[[], bool]) -> None:
        while not is_so():
            self._check_connected()
            await asyncio.sleep(POLL_S)

    def _check_arrived(self) -> None:
        """Raise `SkillFailure`, which names why the motion ended before its end."""
        match self._said["ended"]:
            case "arrived":
                return
            case "lease":
                raise SkillFailure(RobotReason.LOST_COMMANDER, "no heartbeat of the driver came in time")
            case "refused":
                self._check_not_latched(RobotReason.STOP_LATCHED)
                raise SkillFailure(RobotReason.FAULT, "the controller refused the motion")
            case _:
                raise SkillFailure(RobotReason.STOPPED, "the arm braked at an order before the end of the motion")

    def _check_ready(self) -> None:
        self._check_connected()
        self._check_not_latched(RobotReason.STOP_LATCHED)
        if self._said["phase"] != "idle":
            raise SkillFailure("busy", "the arm is moving; wait, or call stop")

    def _check_not_latched(self, reason: RobotReason) -> None:
        if self._said["latched"]:
            raise SkillFailure(reason, "a person has stopped the arm; a person must enable it: dlokit enable")

    def _check_connected(self) -> None:
        if self._lost:
            raise SkillFailure(RobotReason.ROBOT_LOST, "the controller closed the connection; call robot.recover")
