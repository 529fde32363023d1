"""Drivers of the simulated cell's cameras, which call the cell over the bus."""

import asyncio
from dataclasses import dataclass
from typing import ClassVar, cast

from dlokit.communication.skill import Skill
from dlokit.errors import ClockJumped, HardwareError
from dlokit.functional.cameras.base import Caller, Camera, CameraContext
from dlokit.functional.cell.api import CAPTURE, CAPTURE_DEPTH, CLOCK_JUMPED
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages
from dlokit.types.outcome import Failed, Succeeded

Exposure = Skill[[], StereoImages] | Skill[[], DepthImage]
"""A skill of the cell that takes pictures."""


class SimulatedCamera(CameraContext):
    """A `Camera` whose pictures the cell renders."""

    def __init__(self, caller: Caller, exposure: Exposure = CAPTURE) -> None:
        """`exposure` is the cell's skill: CAPTURE for its stereo camera, CAPTURE_DEPTH for its depth camera."""
        super().__init__(is_open=True)
        self._caller = caller
        self._exposure = exposure
        self._calibration: CameraCalibration | None = None

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the last pictures. Raises `HardwareError` before the first."""
        if self._calibration is None:
            raise HardwareError("the simulated camera's calibration comes with its pictures; capture once before")
        return self._calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        """Rendered pictures.

        Raises `HardwareError` when the cell returns none within `timeout_s`, `ClockJumped` after a jump of the
        camera's clock.
        """
        if not self._open:
            raise HardwareError("the simulated camera was closed; enter it again before capturing")
        try:
            async with asyncio.timeout(timeout_s):
                outcome = await self._caller.call(cast(Skill[[], CameraPictures], self._exposure))
        except TimeoutError as error:
            raise HardwareError(
                f"the simulated camera gave no pictures within {timeout_s:g} s; is the cell's process stopped or "
                "overloaded? Look at its log, or allow more time: --perception.capture-timeout-s"
            ) from error
        if isinstance(outcome, Succeeded):
            self._calibration = outcome.result.calibration
            return outcome.result
        if isinstance(outcome, Failed) and outcome.reason == CLOCK_JUMPED:
            raise ClockJumped(outcome.detail)
        raise HardwareError(f"the simulated camera gave no pictures: the call to the cell ended as {outcome}")


@dataclass(frozen=True, kw_only=True)
class SimulatedStereoConfig:
    """The stereo camera of the simulated cell, as in the paper."""

    name: ClassVar[str] = "simulated"
    sees_cell: ClassVar[bool] = True

    def build(self, caller: Caller) -> Camera:
        """The camera."""
        return SimulatedCamera(caller, CAPTURE)


@dataclass(frozen=True, kw_only=True)
class SimulatedD435Config:
    """The depth camera of the simulated cell: a RealSense D435 with its noise, edges and holes."""

    name: ClassVar[str] = "simulated-d435"
    sees_cell: ClassVar[bool] = True

    def build(self, caller: Caller) -> Camera:
        """The camera."""
        return SimulatedCamera(caller, CAPTURE_DEPTH)
