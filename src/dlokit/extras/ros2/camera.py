"""A camera whose pictures are published in ROS 2."""

import asyncio
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, ClassVar, cast

from dlokit.communication.skill import Skill
from dlokit.errors import ClockJumped, HardwareError, install_command
from dlokit.extras.ros2.api import CAPTURE, CAPTURE_DEPTH, CLOCK_JUMPED
from dlokit.functional.cameras.base import Caller, Camera, CameraContext
from dlokit.functional.cameras.picture_topics import PictureTopics
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.outcome import Failed, Succeeded

if TYPE_CHECKING:
    from dlokit.app.doctor.machine import DoctorRow

_ANSWER_S = 0.5
"""Time for the answer of the process `ros` after its own time limit [s]."""


class Ros2Camera(CameraContext):
    """A `Camera` that asks the component connected to ROS 2 for its pictures."""

    def __init__(self, caller: Caller, *, stereo: bool) -> None:
        """`stereo`: its topics are those of a stereo pair."""
        super().__init__(is_open=True)
        self._caller = caller
        self._exposure = cast(Skill[[float], CameraPictures], CAPTURE if stereo else CAPTURE_DEPTH)
        self._calibration: CameraCalibration | None = None

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the last pictures. Raises `HardwareError` before the first."""
        if self._calibration is None:
            raise HardwareError("the calibration of a ROS 2 camera comes with its pictures; capture once before")
        return self._calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        """The next pictures exposed after the call. Raises `HardwareError`, `ClockJumped` after a jump of its clock."""
        if not self._open:
            raise HardwareError("the ROS 2 camera was closed; enter it again before capturing")
        try:
            async with asyncio.timeout(timeout_s + _ANSWER_S):
                outcome = await self._caller.call(self._exposure, timeout_s)
        except TimeoutError as error:
            raise HardwareError(f"the process ros did not answer within {timeout_s + _ANSWER_S:g} s") from error
        if isinstance(outcome, Succeeded):
            self._calibration = outcome.result.calibration
            return outcome.result
        if isinstance(outcome, Failed):
            raise (ClockJumped if outcome.reason == CLOCK_JUMPED else HardwareError)(outcome.detail)
        raise HardwareError(f"the ROS 2 camera gave no pictures: the call to the process ros ended as {outcome}")


@dataclass(frozen=True, kw_only=True)
class Ros2CameraConfig(PictureTopics):
    """A camera that is published in ROS 2, through the node of a workspace."""

    name: ClassVar[str] = "ros2"
    sees_cell: ClassVar[bool] = False

    def build(self, caller: Caller) -> Camera:
        """The camera. Raises `ConfigError` when the topics do not make one."""
        self.check_topics()
        return Ros2Camera(caller, stereo=bool(self.right))

    @classmethod
    def findings(cls) -> "tuple[DoctorRow, ...]":
        """Row of `dlokit doctor` for what ROS 2 needs; `dlokit doctor ros2` looks for cameras."""
        from dlokit.app.doctor.machine import DoctorRow, Severity

        if find_spec("rosbags") is None:
            lacking = "rosbags is only needed for ROS 2"
            return (DoctorRow("ROS 2", Severity.OPTIONAL, lacking, install_command("ros2")),)
        return (DoctorRow("ROS 2", Severity.READY, "rosbags works; `dlokit doctor ros2` looks for a node and cameras"),)
