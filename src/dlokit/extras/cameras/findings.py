"""Checks of cameras by `dlokit doctor`: the package, the library that it loads, and the devices."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.errors import HardwareError, install_command
from dlokit.extras.cameras import genicam, scenescan
from dlokit.extras.cameras.genicam import FoundGenicam, aravis, found_cameras
from dlokit.extras.cameras.realsense import librealsense

_WHAT = "RealSense cameras"


@dataclass(frozen=True, kw_only=True)
class FoundCamera:
    """A connected camera."""

    name: str
    serial: str
    usb: str
    """Version of USB, e.g. 3.2."""


def realsense_finding(search: Callable[[], Sequence[FoundCamera] | None]) -> DoctorRow:
    """Check the driver and the devices; `search` returns None where the package is not installed."""
    try:
        found = search()
    except HardwareError as error:
        fix = f"sudo apt install libusb-1.0-0; {install_command('realsense')}"
        return DoctorRow(_WHAT, Severity.ADVICE, str(error), fix)
    if found is None:
        said = "pyrealsense2 is only needed for RealSense cameras"
        return DoctorRow(_WHAT, Severity.OPTIONAL, said, install_command("realsense"))
    if not found:
        said = "pyrealsense2 works; no camera is connected, or this user may not access it (udev rules)"
        return DoctorRow(_WHAT, Severity.READY, said)
    said = ", ".join(f"{one.name} {one.serial} on USB {one.usb}" for one in found)
    if any(one.usb.startswith("2") for one in found):
        fix = "plug it into a port of USB 3, with the cable of its maker"
        return DoctorRow(_WHAT, Severity.ADVICE, f"{said}: too slow for 30 pictures/s", fix)
    return DoctorRow(_WHAT, Severity.READY, said)


def connected_realsense() -> tuple[FoundCamera, ...] | None:
    """The connected cameras; None where pyrealsense2 is not installed. Raises `HardwareError` where it cannot load."""
    if find_spec("pyrealsense2") is None:
        return None
    rs = librealsense()

    def told(device: Any, what: Any) -> str:
        return device.get_info(what) if device.supports(what) else "unknown"

    try:
        devices = list(rs.context().query_devices())
    except RuntimeError as error:  # what librealsense raises for everything
        raise HardwareError(f"librealsense cannot list the cameras: {error}") from error
    return tuple(
        FoundCamera(
            name=told(device, rs.camera_info.name),
            serial=told(device, rs.camera_info.serial_number),
            usb=told(device, rs.camera_info.usb_type_descriptor),
        )
        for device in devices
    )


def genicam_finding(search: Callable[[], Sequence[FoundGenicam] | None]) -> DoctorRow:
    """Check aravis and the devices; `search` returns None where aravis is not installed."""
    what, found = "GenICam cameras", search()
    if found is None:
        said = "aravis is only needed for GenICam cameras"
        return DoctorRow(what, Severity.OPTIONAL, said, genicam.INSTALL)
    said = ", ".join(map(str, found)) or "aravis works; no camera answers: check power, cable and network address"
    return DoctorRow(what, Severity.READY, said)


def connected_genicam() -> tuple[FoundGenicam, ...] | None:
    """The cameras that answer within a second; None where aravis is not installed for this Python."""
    try:
        return tuple(found_cameras(aravis()))
    except HardwareError:
        return None


def scenescan_finding(search: Callable[[], Sequence[str] | None]) -> DoctorRow:
    """Check visiontransfer and the devices; `search` returns None where the package is not installed."""
    what = "SceneScan cameras"
    try:
        found = search()
    except HardwareError as error:
        return DoctorRow(what, Severity.ADVICE, str(error), scenescan.INSTALL)
    if found is None:
        said = "visiontransfer is only needed for SceneScan cameras"
        return DoctorRow(what, Severity.OPTIONAL, said, scenescan.INSTALL)
    said = ", ".join(found) or "visiontransfer works; no camera answers: check power, cable and network address"
    return DoctorRow(what, Severity.READY, said)


def connected_scenescan() -> tuple[str, ...] | None:
    """The cameras that answer; None where visiontransfer is not installed. Raises `HardwareError` where it fails."""
    if find_spec("visiontransfer") is None:
        return None
    try:
        return tuple(str(device) for device in scenescan.visiontransfer().DeviceEnumeration().discover_devices())
    except RuntimeError as error:  # what visiontransfer raises for everything
        raise HardwareError(f"visiontransfer cannot list the cameras: {error}") from error
