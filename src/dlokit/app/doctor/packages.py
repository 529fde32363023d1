"""Checks of packages and devices by `dlokit doctor`; drivers and cameras report what they find of theirs."""

import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from importlib.util import find_spec
from typing import Protocol, runtime_checkable

from packaging.requirements import Requirement

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.errors import install_command
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.robots.strategies import DRIVERS


def dependency_findings(distribution: str = "dlokit") -> tuple[DoctorRow, ...]:
    """Check the packages that dlokit requires, with their versions, and those of the extra `cell`."""
    try:
        required = [Requirement(line) for line in metadata.requires(distribution) or []]
    except metadata.PackageNotFoundError:
        fix = f"{sys.executable} -m pip install -e . in the folder of its clone"
        return (DoctorRow(distribution, Severity.LACKING, "not installed as a package", fix),)
    own = DoctorRow(distribution, Severity.READY, metadata.version(distribution))
    return (
        own,
        *(package_finding(one, _version) for one in required if _is_of(one, "")),
        *(
            package_finding(one, _version, only_for="shaping")
            for one in required
            if _is_of(one, "cell") and not _is_of(one, "")
        ),
    )


def _is_of(required: Requirement, extra: str) -> bool:
    return required.marker is None or required.marker.evaluate({"extra": extra})


def package_finding(required: Requirement, version_of: Callable[[str], str | None], only_for: str = "") -> DoctorRow:
    """Check one required package; one that is needed `only_for` something may be missing."""
    fix = f"pip install '{required.name}{required.specifier}'"
    version = version_of(required.name)
    if version is None and only_for:
        found = f"only needed for {only_for}, not for tracking"
        return DoctorRow(required.name, Severity.OPTIONAL, found, install_command("all"))
    if version is None:
        return DoctorRow(required.name, Severity.LACKING, "not installed", fix)
    if not required.specifier.contains(version, prereleases=True):
        found = f"{version}; {required.specifier} is needed"
        return DoctorRow(required.name, Severity.LACKING, found, fix)
    return DoctorRow(required.name, Severity.READY, version)


def device_package_finding(package: str, module: str, purpose: str, fix: str) -> DoctorRow:
    """Check the package of a device, which is optional; `fix` installs it."""
    if importable(module):
        return DoctorRow(package, Severity.READY, f"for {purpose}")
    return DoctorRow(package, Severity.OPTIONAL, f"only needed for {purpose}", fix)


def importable(module: str) -> bool:
    """Whether a module is installed, without running it: drivers may access their device on import."""
    return find_spec(module) is not None


def _version(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


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
