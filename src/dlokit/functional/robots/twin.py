"""A driver's arm in a twin run: the device moves and grips, and the finger feedback comes from the cell's arm.

The system builds it only where the camera sees the simulated cell, so that no other run gets this feedback.
"""

import asyncio
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Self

import msgspec

from dlokit.communication.container import end_tasks
from dlokit.description.arm.model import ArmModel
from dlokit.functional.robots.base import Robot
from dlokit.types.robot import ArmProtection, GripResult, JointTrajectory, Lease, MotionResult, RobotState


class TwinRobot:
    """The device, except for its finger feedback, because no DLO is between its fingers."""

    def __init__(self, device: Robot, fingers: Robot) -> None:
        """`fingers` is the cell's arm, which mirrors the joints of the `device`; only its fingers are ordered here."""
        self._device = device
        self._fingers = fingers
        self._opened = AsyncExitStack()

    @property
    def arm(self) -> ArmModel:
        """The device's arm."""
        return self._device.arm

    async def __aenter__(self) -> Self:
        """Connect to the cell and to the device. Raises `HardwareError` when one does not answer."""
        async with AsyncExitStack() as opening:
            await opening.enter_async_context(self._fingers)
            await opening.enter_async_context(self._device)
            self._opened = opening.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the device at rest and disconnect from both."""
        await self._opened.aclose()

    def state(self) -> RobotState:
        """The device's state, with the width of the cell's fingers and whether they hold something."""
        felt = self._fingers.state()
        return msgspec.structs.replace(self._device.state(), finger_width_m=felt.finger_width_m, holding=felt.holding)

    def protection(self) -> ArmProtection | None:
        """The protection settings of the device."""
        return self._device.protection()

    def now_ns(self) -> int:
        """The device's clock."""
        return self._device.now_ns()

    def newest_ns(self) -> int:
        """Stamp of the device's newest feedback."""
        return self._device.newest_ns()

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory on the device."""
        return await self._device.follow(trajectory, lease)

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Move the fingers of both; returns the feedback of the cell's fingers when both are at rest."""
        feeling = asyncio.create_task(self._fingers.grip(width_m, force_n, lease))
        try:
            await self._device.grip(width_m, force_n, lease)
            return await feeling
        finally:
            await end_tasks(feeling)

    async def halt(self) -> None:
        """Brake the device."""
        await self._device.halt()

    async def stop(self) -> None:
        """Stop the device and latch, then hold the cell's fingers."""
        await self._device.stop()
        await self._fingers.stop()

    async def enable(self) -> None:
        """Clear the stop of both."""
        await self._device.enable()
        await self._fingers.enable()

    def brake(self) -> None:
        """Order the device to brake."""
        self._device.brake()

    async def recover(self) -> None:
        """Clear a fault of the device."""
        await self._device.recover()
