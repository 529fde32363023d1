"""Checks of packages by `dlokit doctor`: required ones, and optional ones of devices."""

import sys
from collections.abc import Callable
from importlib import metadata
from importlib.util import find_spec

from packaging.requirements import Requirement

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.errors import install_command


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
