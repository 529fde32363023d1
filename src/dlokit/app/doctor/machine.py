"""Checks of the machine, its packages and devices by `dlokit doctor`: one row each, with the command that fixes it."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from importlib import metadata
from importlib.util import find_spec
from typing import Protocol, runtime_checkable

from packaging.requirements import Requirement

from dlokit.app.doctor.opengl import OpenGLReport
from dlokit.cache_folder import compiled_code_folder
from dlokit.errors import MachineError, install_command, pip_command
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.robots.strategies import DRIVERS

NEEDED_MEMORY_GIB = 2.0
"""Memory that a live run with all processes uses, approximately [GiB]."""
NEEDED_CORES = 2
"""One core for the cell and the model, one for perception and the rest."""


class Severity(Enum):
    """How severe a finding is."""

    READY = "ready"
    LACKING = "lacking"
    """dlokit does not run without it."""
    ADVICE = "advice"
    """dlokit runs, but not as well as it could."""
    OPTIONAL = "not installed"
    """Needed only for the purpose that the text names."""
    SKIPPED = "skipped"
    """A step that was not done; the text says why."""


@dataclass(frozen=True)
class DoctorRow:
    """One row of the table."""

    what: str
    standing: Severity
    found: str
    fix: str = ""
    """The command that fixes it; empty if there is nothing to fix."""


def python_finding(version: Sequence[int]) -> DoctorRow:
    """Check the Python version."""
    found = ".".join(map(str, version))
    if tuple(version[:2]) >= (3, 11):
        return DoctorRow("Python", Severity.READY, found)
    return DoctorRow("Python", Severity.LACKING, f"{found}; 3.11 or newer is needed", "uv python install 3.11")


def opengl_finding(report: OpenGLReport | None) -> DoctorRow:
    """Check rendering, which the simulated cell needs for its cameras; None: it was not tried, without MuJoCo."""
    if report is None:
        found, fix = "not tried: MuJoCo is not installed", install_command("all")
        return DoctorRow("OpenGL (EGL)", Severity.OPTIONAL, found, fix)
    if report.works:
        return DoctorRow("OpenGL (EGL)", Severity.READY, report.text)
    fix = "sudo apt install libegl1 libopengl0 libgl1-mesa-dri"
    return DoctorRow("OpenGL (EGL)", Severity.LACKING, report.text, fix)


def cores_finding(cores: int) -> DoctorRow:
    """Check the number of processor cores that this process may use."""
    if cores >= NEEDED_CORES:
        return DoctorRow("processor", Severity.READY, f"{cores} cores")
    return DoctorRow(
        "processor",
        Severity.ADVICE,
        f"{cores} core; a live run wants {NEEDED_CORES}",
        "dlokit shape --runtime lockstep",
    )


def memory_finding(available_gib: float) -> DoctorRow:
    """Check the available memory."""
    found = f"{available_gib:.1f} GiB available"
    if available_gib >= NEEDED_MEMORY_GIB:
        return DoctorRow("memory", Severity.READY, found)
    return DoctorRow(
        "memory",
        Severity.ADVICE,
        f"{found}; a live run wants {NEEDED_MEMORY_GIB:.0f} GiB",
        "close other programs, or dlokit shape --runtime lockstep",
    )


def urgency_finding(allowed: bool) -> DoctorRow:
    """Check whether the threads on which the braking latency depends may have real-time priority."""
    if allowed:
        return DoctorRow("real-time priority", Severity.READY, "allowed, for braking the arms")
    return DoctorRow(
        "real-time priority",
        Severity.ADVICE,
        "not allowed; on an overloaded machine an arm may brake late, or without cause",
        'echo "$USER - rtprio 10" | sudo tee /etc/security/limits.d/dlokit.conf  # then log in again',
    )


def _check_shared_memory() -> None:
    if importable("zenoh"):  # only a live run needs it
        from dlokit.communication.zenoh.session import check_shared_memory

        check_shared_memory()


def shared_memory_finding(check: Callable[[], None] = _check_shared_memory) -> DoctorRow:
    """Check the memory that the processes of a live run share."""
    what = "shared memory"
    try:
        check()
    except MachineError as error:
        return DoctorRow(what, Severity.ADVICE, str(error), "dlokit shape --runtime lockstep")
    return DoctorRow(what, Severity.READY, "can be written, for live runs")


def port_finding(host: str, port: int) -> DoctorRow:
    """Check the viewer's port."""
    what = f"viewer port {port}"
    try:
        # Imported here, because the doctor must be able to report a missing package of the viewer.
        from dlokit.skills.viewer.serving.address import check_port

        check_port(host, port)
    except (ImportError, MachineError) as error:
        return DoctorRow(what, Severity.ADVICE, str(error), "dlokit demo --port 0")
    return DoctorRow(what, Severity.READY, f"free on {host}")


def kernels_finding() -> DoctorRow:
    """Compile the kernels of observers and planners if necessary, so that no run waits for compilation."""
    what = "compiled kernels"
    try:
        folder = compiled_code_folder()
    except MachineError as error:
        return DoctorRow(what, Severity.LACKING, str(error), "export NUMBA_CACHE_DIR=…")
    try:
        # Imported here, because the doctor must be able to report a missing package of the kernels.
        from dlokit.rod.rollout import load_kernels as load_planning_kernels
        from dlokit.skills.observer.kernels import load_kernels
    except ImportError as error:
        return DoctorRow(what, Severity.ADVICE, str(error), "install what the rows above lack")
    loaded_s = load_kernels() + load_planning_kernels()
    return DoctorRow(what, Severity.READY, f"kept in {folder}, loaded in {loaded_s:.1f} s")


def browser_finding(which: Callable[[str], str | None]) -> DoctorRow:
    """Check for Chromium, which the browser tests drive. The viewer works with any browser."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = which(name)
        if path is not None:
            return DoctorRow("chromium", Severity.READY, path)
    found = "only needed for the browser tests"
    return DoctorRow("chromium", Severity.OPTIONAL, found, "sudo apt install chromium")


def usable_cores() -> int:
    """Number of cores this process may run on; a container may limit it."""
    if sys.platform.startswith("linux"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def dependency_findings(distribution: str = "dlokit") -> tuple[DoctorRow, ...]:
    """Check the packages that dlokit requires, with their versions, and those of the extra `cell`."""
    try:
        required = [Requirement(line) for line in metadata.requires(distribution) or []]
    except metadata.PackageNotFoundError:
        fix = install_command("all")
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
    fix = pip_command(f"{required.name}{required.specifier}")
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
        """Their serial numbers, or all names that select them; empty for one that reports none.

        None where its package is missing. Raises `HardwareError`.
        """
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
