"""What a camera is."""

import threading
from types import TracebackType
from typing import ClassVar, ParamSpec, Protocol, Self, TypeVar, runtime_checkable

from dlokit.communication.skill import Skill
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.outcome import Outcome

P = ParamSpec("P")
R = TypeVar("R")


JUMP_NS = 500_000_000
"""A stamp that is off its arrival by this more or less than those before is of a clock that has jumped [ns].

A device that starts again, and NTP, which steps what is off by more than 0.128 s, move a clock by a second or more;
half of that keeps a jump of exactly a second from being missed for the delay of a picture on a busy machine."""


class Camera(Protocol):
    """A device that takes stamped pictures. A context manager: entering connects, leaving disconnects.

    Example: ``with camera: pair = await camera.capture(timeout_s=2.0)``
    """

    @property
    def calibration(self) -> CameraCalibration:
        """Intrinsics, baseline if any, and T_world_camera as it is believed to be.

        Raises `HardwareError` while it is not known, before the device has been asked.
        """
        ...

    async def capture(self, timeout_s: float) -> CameraPictures:
        """Pictures exposed after the call, with the stamp of their exposure on the clock of the run.

        Perception refuses a stamp that lies farther than `JUMP_NS` before the call or after the arrival.

        Raises `HardwareError` when there are none within `timeout_s`, or when the device is gone.
        """
        ...

    def __enter__(self) -> Self:
        """Connect. Raises `HardwareError` when the device is not there."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect; no pictures after this."""
        ...


class CameraContext:
    """What a camera is as a context manager: open between entering and leaving, for one caller at a time."""

    def __init__(self, *, is_open: bool = False) -> None:
        """`is_open`: it gives pictures without being entered first."""
        self._open = is_open
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        """Connect. Raises `HardwareError` when the device is not there."""
        with self._lock:
            self._connect()
            self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect; no pictures after this."""
        self._open = False
        with self._lock:
            self._disconnect()

    def _connect(self) -> None:
        """Connect to the device, if there is one. Raises `HardwareError`."""

    def _disconnect(self) -> None:
        """Disconnect from it."""


class Caller(Protocol):
    """Whatever can call a skill: a transport, or a component's port."""

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Ask a component for a skill."""
        ...


class CameraConfig(Protocol):
    """The settings of a camera: a frozen dataclass, all fields with defaults, that knows how to build it.

    Every process loads it, with the module in which it is: large libraries are imported where they are called.
    """

    name: ClassVar[str]
    sees_cell: ClassVar[bool]
    """Whether its pictures show the simulated cell, whose arm then moves what the camera sees."""

    def build(self, caller: Caller) -> Camera:
        """The camera with these settings. One that is no device of its own asks the cell through `caller`.

        Raises `ConfigError` when a setting names something that is missing.
        """
        ...


@runtime_checkable
class UncalibratedConfig(Protocol):
    """Settings of a camera that does not know its own optics: for pictures of a board it needs no calibration."""

    @property
    def calibration(self) -> str:
        """File with its optics; empty before its calibration."""
        ...

    def uncalibrated(self) -> Camera:
        """The camera before its calibration. Raises `ConfigError`."""
        ...
