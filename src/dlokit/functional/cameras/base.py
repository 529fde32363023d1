"""The protocol of cameras and of their settings."""

import threading
from types import TracebackType
from typing import ClassVar, ParamSpec, Protocol, Self, TypeVar, runtime_checkable

from dlokit.communication.skill import Skill
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.outcome import Outcome

P = ParamSpec("P")
R = TypeVar("R")


JUMP_NS = 500_000_000
"""If the delay between stamp and arrival changes by more than this, the camera's clock has jumped [ns].

A restart of the device, or NTP, which steps clocks that are off by more than 0.128 s, moves a clock by a second or
more; half a second also detects a jump of one second when a busy machine delays a picture."""


class Camera(Protocol):
    """A device that takes stamped pictures. A context manager: entering connects, leaving disconnects.

    Example: ``with camera: pair = await camera.capture(timeout_s=2.0)``
    """

    @property
    def calibration(self) -> CameraCalibration:
        """Intrinsics, baseline if any, and the believed T_world_camera.

        Raises `HardwareError` before the device has reported it.
        """
        ...

    async def capture(self, timeout_s: float) -> CameraPictures:
        """Pictures exposed after the call, with the stamp of their exposure on the clock of the run.

        Perception refuses a stamp more than `JUMP_NS` before the call or after the arrival.

        Raises `HardwareError` when none arrive within `timeout_s`, or when the device is gone.
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
    """A camera's context manager: the camera is open between entering and leaving, for one caller at a time."""

    def __init__(self, *, is_open: bool = False) -> None:
        """`is_open`: it returns pictures without being entered first."""
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
    """An object that can call a skill: a transport, or a component's port."""

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Call a skill of a component."""
        ...


class CameraConfig(Protocol):
    """The settings of a camera: a frozen dataclass, all fields with defaults, with a method that builds the camera.

    Every process loads it and its module, so large libraries are imported in the methods that call them.
    """

    name: ClassVar[str]
    sees_cell: ClassVar[bool]
    """Whether its pictures show the simulated cell, so that the cell's arm moves the DLO in the picture."""

    def build(self, caller: Caller) -> Camera:
        """The camera with these settings. A simulated camera calls the cell through `caller`.

        Raises `ConfigError` when a setting names something that is missing.
        """
        ...


@runtime_checkable
class UncalibratedConfig(Protocol):
    """Settings of a camera that does not report its own optics: for pictures of a board it needs no calibration."""

    @property
    def calibration(self) -> str:
        """File with its optics; empty before its calibration."""
        ...

    def uncalibrated(self) -> Camera:
        """The camera before its calibration. Raises `ConfigError`."""
        ...


@runtime_checkable
class SerialConfig(Protocol):
    """Settings of a camera that is chosen by its serial number, and by nothing else."""

    @property
    def serial(self) -> str:
        """Serial number of the device; empty: the only one."""
        ...
