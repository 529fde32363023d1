"""What `dlokit doctor` finds of the machine itself: a row each, with the command that mends it."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from dlokit.app.doctor.opengl import OpenGLReport
from dlokit.errors import MachineError

NEEDED_MEMORY_GIB = 2.0

"""A live run with all processes takes about that much."""
NEEDED_CORES = 2

"""Cell and model on one, perception and the rest on the other."""


class Severity(Enum):
    """How a finding stands."""

    READY = "ready"
    LACKING = "lacking"
    """dlokit does not run without it."""
    ADVICE = "advice"
    """dlokit runs, but not as well as it could."""
    OPTIONAL = "not installed"
    """Only needed for what the text says."""


@dataclass(frozen=True, kw_only=True)
class DoctorRow:
    """One row of the table."""

    what: str
    standing: Severity
    found: str
    mend: str = ""
    """The command that mends it; empty where nothing is to be mended."""


def python_finding(version: Sequence[int]) -> DoctorRow:
    """The interpreter."""
    found = ".".join(map(str, version))
    if tuple(version[:2]) >= (3, 11):
        return DoctorRow(what="Python", standing=Severity.READY, found=found)
    return DoctorRow(
        what="Python",
        standing=Severity.LACKING,
        found=f"{found}; 3.11 or newer is needed",
        mend="uv python install 3.11",
    )


def opengl_finding(report: OpenGLReport) -> DoctorRow:
    """Rendering, which the simulated cell needs for its cameras."""
    if report.works:
        return DoctorRow(what="OpenGL (EGL)", standing=Severity.READY, found=report.text)
    return DoctorRow(
        what="OpenGL (EGL)",
        standing=Severity.LACKING,
        found=report.text,
        mend="sudo apt install libegl1 libgl1 libgl1-mesa-dri",
    )


def cores_finding(cores: int) -> DoctorRow:
    """Processor cores that this process may use."""
    if cores >= NEEDED_CORES:
        return DoctorRow(what="processor", standing=Severity.READY, found=f"{cores} cores")
    return DoctorRow(
        what="processor",
        standing=Severity.ADVICE,
        found=f"{cores} core; a live run wants {NEEDED_CORES}",
        mend="dlokit shape --runtime lockstep",
    )


def memory_finding(available_gib: float) -> DoctorRow:
    """Memory that is free now."""
    found = f"{available_gib:.1f} GiB available"
    if available_gib >= NEEDED_MEMORY_GIB:
        return DoctorRow(what="memory", standing=Severity.READY, found=found)
    return DoctorRow(
        what="memory",
        standing=Severity.ADVICE,
        found=f"{found}; a live run wants {NEEDED_MEMORY_GIB:.0f} GiB",
        mend="close other programs, or dlokit shape --runtime lockstep",
    )


def urgency_finding(allowed: bool) -> DoctorRow:
    """Whether the threads on which it depends how soon an arm brakes may go before everything else."""
    if allowed:
        return DoctorRow(what="real-time priority", standing=Severity.READY, found="allowed, for what brakes the arms")
    return DoctorRow(
        what="real-time priority",
        standing=Severity.ADVICE,
        found="not allowed; on an overloaded machine an arm brakes later, or for nothing",
        mend='echo "$USER - rtprio 10" | sudo tee /etc/security/limits.d/dlokit.conf  # then log in again',
    )


def port_finding(host: str, port: int) -> DoctorRow:
    """The viewer's port."""
    what = f"viewer port {port}"
    try:
        # Here, because the doctor must be able to tell that a package of the viewer is missing.
        from dlokit.skills.viewer.address import check_port

        check_port(host, port)
    except (ImportError, MachineError) as error:
        return DoctorRow(what=what, standing=Severity.ADVICE, found=str(error), mend="dlokit demo --port 0")
    return DoctorRow(what=what, standing=Severity.READY, found=f"free on {host}")


def kernels_finding() -> DoctorRow:
    """The compiled code of observers and planners, made here if it is not there yet, so that nothing waits for it."""
    what = "compiled kernels"
    try:
        # Here, because the doctor must be able to tell that a package which they need is missing.
        from dlokit.rod.rollout import warm as warm_planning
        from dlokit.skills.observer.kernels import warm
    except ImportError as error:
        return DoctorRow(what=what, standing=Severity.ADVICE, found=str(error), mend="pip install dlokit")
    loaded_s = warm() + warm_planning()
    return DoctorRow(what=what, standing=Severity.READY, found=f"compiled, kept on disk, loaded in {loaded_s:.1f} s")


def browser_finding(which: Callable[[str], str | None]) -> DoctorRow:
    """A Chromium, which the browser tests drive. People may look at the viewer with any browser."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = which(name)
        if path is not None:
            return DoctorRow(what="chromium", standing=Severity.READY, found=path)
    found = "only needed for the browser tests"
    return DoctorRow(what="chromium", standing=Severity.OPTIONAL, found=found, mend="sudo apt install chromium")


def usable_cores() -> int:
    """Cores this process may run on, which a container limits below what the machine has."""
    if sys.platform.startswith("linux"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
