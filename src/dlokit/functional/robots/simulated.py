"""An arm of the simulated cell: every method calls a skill of the cell."""

import asyncio
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import ClassVar, Self, TypeVar

from dlokit.communication import topics
from dlokit.communication.port import Port
from dlokit.communication.timing.pulse import Pulse, loop_pulse
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.errors import HardwareError, SkillFailure
from dlokit.functional.cell import api
from dlokit.functional.robots.base import Robot
from dlokit.types.outcome import Cancelled, Outcome, Rejected, Succeeded, TimedOut, Unreachable
from dlokit.types.robot import (
    ArmProtection,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotReason,
    RobotState,
)
from dlokit.types.system import ClockTick

R = TypeVar("R")

_CONNECT_S = 10.0


class SimulatedRobot:
    """Drives an arm of the cell through a port."""

    def __init__(self, port: Port, mount: ArmMount = FIRST_ALONE[0], pulse: Pulse = loop_pulse) -> None:
        """`pulse` sends the heartbeats during a motion."""
        self._port = port
        self._pulse = pulse
        self._robot = mount.robot
        self.arm = mount.model
        """The arm as it is mounted."""
        self._states = topics.ARM_STATE.at(mount.instance)
        self._state: RobotState | None = None
        self._heard = asyncio.Event()
        self._reader: asyncio.Task[None] | None = None
        self._now_ns = self._newest_ns = 0

    async def __aenter__(self) -> Self:
        """Wait for the arm's first state. Raises `HardwareError` after 10 s of the machine's clock."""
        self._reader = asyncio.create_task(self._read_states(), name="arm states")
        # Received outside the loop: the age of feedback must not depend on how busy this process is.
        self._port.tap(topics.CLOCK, self._receive_tick)
        self._port.tap(self._states, self._receive_state)
        try:
            async with asyncio.timeout(_CONNECT_S):
                await self._heard.wait()
        except TimeoutError:
            self._reader.cancel()
            raise HardwareError(
                f"no state of the arm {self._robot} came from the cell within {_CONNECT_S:.0f} s; is the cell running?"
            ) from None
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Brake in any case; without a cell, no arm needs to brake."""
        await self._port.call(api.BRAKE, self._robot)
        if self._reader is not None:
            self._reader.cancel()

    async def _read_states(self) -> None:
        async for state in self._port.stream(self._states):
            self._state = state
            self._heard.set()

    def _receive_tick(self, tick: ClockTick) -> None:
        self._now_ns = tick.stamp_ns

    def _receive_state(self, state: RobotState) -> None:
        self._newest_ns = state.stamp_ns

    def state(self) -> RobotState:
        """The newest state from the cell."""
        if self._state is None:
            raise HardwareError("no state of the arm has arrived yet; start the cell, and wait for its first state")
        return self._state

    def now_ns(self) -> int:
        """The cell's clock; clock and arm pause while the cell renders a picture."""
        return self._now_ns

    def newest_ns(self) -> int:
        """Stamp of the newest state from the cell, including states published before this process joined."""
        return max(self._newest_ns, self.state().stamp_ns)

    def protection(self) -> ArmProtection | None:
        """None: a simulated arm has no thresholds."""
        return None

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory, and renew the lease meanwhile; a cancelled call brakes the arm."""
        renew = partial(self._port.send, api.RENEW, self._robot)
        async with self._pulse(renew, lease.heartbeat_s):
            return _result(await self._port.call(api.FOLLOW, trajectory, lease.duration_s, self._robot))

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Move the fingers to a width, and renew the lease meanwhile."""
        renew = partial(self._port.send, api.RENEW, self._robot)
        async with self._pulse(renew, lease.heartbeat_s):
            return _result(await self._port.call(api.GRIP, width_m, force_n, lease.duration_s, self._robot))

    async def halt(self) -> None:
        """Brake."""
        _result(await self._port.call(api.BRAKE, self._robot))

    async def stop(self) -> None:
        """Stop the arm, and latch."""
        _result(await self._port.call(api.STOP, self._robot))

    async def enable(self) -> None:
        """Clear the stop of the arm."""
        _result(await self._port.call(api.ENABLE, self._robot))

    def brake(self) -> None:
        """Order the cell to brake."""
        self._port.send(api.BRAKE, self._robot)

    async def recover(self) -> None:
        """Clear a fault."""
        _result(await self._port.call(api.RECOVER, self._robot))


def _result(outcome: Outcome[R]) -> R:
    """The result of a call to the cell. Raises `SkillFailure` for any other outcome."""
    match outcome:
        case Succeeded(result=result):
            return result
        case Cancelled():
            raise SkillFailure(RobotReason.STOPPED, "the cell stopped the motion")
        case TimedOut() | Unreachable():
            raise SkillFailure(RobotReason.ROBOT_LOST, f"no answer of the cell: {outcome.why}")
        case Rejected(reason=reason, detail=detail):  # by the cell: here the skill of the robot has begun
            raise SkillFailure(reason, detail)
        case _:
            return outcome.unwrap()


@dataclass(frozen=True, kw_only=True)
class SimulatedRobotConfig:
    """The arm of the simulated cell."""

    name: ClassVar[str] = "simulated"
    in_cell: ClassVar[bool] = True
    is_real: ClassVar[bool] = False

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        """The driver."""
        return SimulatedRobot(port, mount, pulse)
