"""Checks of devices by `dlokit doctor`: what the settings of the installed drivers and cameras say of theirs."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from dlokit.app.doctor.machine import DoctorRow
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.robots.strategies import DRIVERS


@runtime_checkable
class ExaminedDevice(Protocol):
    """Settings of a driver or camera whose class also knows what its package finds on this machine."""

    @classmethod
    def findings(cls) -> tuple[DoctorRow, ...]:
        """Rows for the packages that it needs, and for its devices that are connected."""
        ...


@runtime_checkable
class ConnectedDevice(Protocol):
    """Settings of a camera whose class also knows which of its devices are connected."""

    @classmethod
    def connected_serials(cls) -> Sequence[str] | None:
        """Their serial numbers; None where its package is missing. Raises `HardwareError`."""
        ...


def device_findings() -> tuple[DoctorRow, ...]:
    """Check the packages and devices of all installed drivers and cameras."""
    installed = (*DRIVERS.installed().values(), *CAMERAS.installed().values())
    return tuple(row for config in installed if isinstance(config, ExaminedDevice) for row in config.findings())


def connected_serials(camera: str) -> Sequence[str] | None:
    """The serials of the cameras of this name that are connected; None where they cannot be asked.

    Raises `HardwareError` where the camera's package fails.
    """
    config = CAMERAS.installed().get(camera)
    return config.connected_serials() if isinstance(config, ConnectedDevice) else None
