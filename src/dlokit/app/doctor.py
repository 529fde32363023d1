"""`dlokit doctor`: what this machine has, what it lacks, and the command that mends it."""

import os
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from importlib import import_module, metadata
from importlib.util import find_spec

import psutil
from packaging.requirements import Requirement
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dlokit.app.opengl_probe import OpenGLReport, probe_opengl
from dlokit.communication.pulse import may_be_urgent
from dlokit.errors import MachineError

NEEDED_MEMORY_GIB = 2.0
"""A live run with all processes takes about that much."""
NEEDED_CORES = 2
"""Cell and model on one, perception and the rest on the other."""
EXIT_READY, EXIT_LACKING = 0, 2


class Standing(Enum):
    """How a finding stands."""

    READY = "ready"
    LACKING = "lacking"
    """dlokit does not run without it."""
    ADVICE = "advice"
    """dlokit runs, but not as well as it could."""
    OPTIONAL = "not installed"
    """Only needed for what the text says."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One row of the table."""

    what: str
    standing: Standing
    found: str
    mend: str = ""
    """The command that mends it; empty where nothing is to be mended."""


@dataclass(frozen=True, kw_only=True)
class DoctorArgs:
    """Tell what this machine has, what it lacks, and the command that mends it."""

    viewer_host: str = "127.0.0.1"
    """Address that the viewer would listen on."""
    viewer_port: int = 8080
    """Port that the viewer would listen on."""
    opengl_timeout_s: float = 60.0
    """Time to wait for one tiny picture [s]."""


def run(args: DoctorArgs) -> int:
    """Print what was found. Returns 0 when everything needed is there, else 2."""
    findings = examine(args)
    console = Console()
    console.print(findings_table(findings))
    lacking = [finding.what for finding in findings if finding.standing is Standing.LACKING]
    if lacking:
        console.print(f"[bold red]dlokit cannot run here yet:[/] {', '.join(lacking)}.", highlight=False)
        return EXIT_LACKING
    console.print("[bold green]dlokit can run here.[/] Try: dlokit demo", highlight=False)
    return EXIT_READY


def examine(args: DoctorArgs) -> tuple[Finding, ...]:
    """Look at everything, in the order of the table."""
    return (
        python_finding(sys.version_info[:3]),
        opengl_finding(probe_opengl(args.opengl_timeout_s)),
        cores_finding(_usable_cores()),
        urgency_finding(may_be_urgent()),
        memory_finding(psutil.virtual_memory().available / 2**30),
        port_finding(args.viewer_host, args.viewer_port),
        *dependency_findings(),
        kernels_finding(),
        *(hardware_finding(package, _importable) for package in HARDWARE),
        browser_finding(shutil.which),
    )


def findings_table(findings: Sequence[Finding]) -> Table:
    """The findings as a table; commands stay in one piece, so that they can be copied."""
    styles = {
        Standing.READY: "green",
        Standing.LACKING: "bold red",
        Standing.ADVICE: "yellow",
        Standing.OPTIONAL: "dim",
    }
    table = Table(title="dlokit doctor", title_justify="left", title_style="bold")
    table.add_column("what", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("found", overflow="fold")
    table.add_column("to mend it", overflow="fold")
    for finding in findings:
        standing = Text(finding.standing.value, style=styles[finding.standing])
        table.add_row(finding.what, standing, Text(finding.found), Text(finding.mend, style="cyan"))
    return table


def python_finding(version: Sequence[int]) -> Finding:
    """The interpreter."""
    found = ".".join(map(str, version))
    if tuple(version[:2]) >= (3, 11):
        return Finding(what="Python", standing=Standing.READY, found=found)
    return Finding(
        what="Python",
        standing=Standing.LACKING,
        found=f"{found}; 3.11 or newer is needed",
        mend="uv python install 3.11",
    )


def opengl_finding(report: OpenGLReport) -> Finding:
    """Rendering, which the simulated cell needs for its cameras."""
    if report.works:
        return Finding(what="OpenGL (EGL)", standing=Standing.READY, found=report.text)
    return Finding(
        what="OpenGL (EGL)",
        standing=Standing.LACKING,
        found=report.text,
        mend="sudo apt install libegl1 libgl1 libgl1-mesa-dri",
    )


def cores_finding(cores: int) -> Finding:
    """Processor cores that this process may use."""
    if cores >= NEEDED_CORES:
        return Finding(what="processor", standing=Standing.READY, found=f"{cores} cores")
    return Finding(
        what="processor",
        standing=Standing.ADVICE,
        found=f"{cores} core; a live run wants {NEEDED_CORES}",
        mend="dlokit shape --runtime lockstep",
    )


def memory_finding(available_gib: float) -> Finding:
    """Memory that is free now."""
    found = f"{available_gib:.1f} GiB available"
    if available_gib >= NEEDED_MEMORY_GIB:
        return Finding(what="memory", standing=Standing.READY, found=found)
    return Finding(
        what="memory",
        standing=Standing.ADVICE,
        found=f"{found}; a live run wants {NEEDED_MEMORY_GIB:.0f} GiB",
        mend="close other programs, or dlokit shape --runtime lockstep",
    )


def urgency_finding(allowed: bool) -> Finding:
    """Whether the threads that keep the robots' leases may go before everything else on a busy machine."""
    if allowed:
        return Finding(what="real-time priority", standing=Standing.READY, found="allowed, for signs of life")
    return Finding(
        what="real-time priority",
        standing=Standing.ADVICE,
        found="not allowed; on an overloaded machine a sign of life may come late, and the arm then brakes",
        mend='echo "$USER - rtprio 10" | sudo tee /etc/security/limits.d/dlokit.conf  # then log in again',
    )


def port_finding(host: str, port: int) -> Finding:
    """The viewer's port."""
    what = f"viewer port {port}"
    try:
        # Here, because the doctor must be able to tell that a package of the viewer is missing.
        from dlokit.skills.viewer.page import check_port

        check_port(host, port)
    except (ImportError, MachineError) as error:
        return Finding(what=what, standing=Standing.ADVICE, found=str(error), mend="dlokit demo --viewer.port 0")
    return Finding(what=what, standing=Standing.READY, found=f"free on {host}")


def kernels_finding() -> Finding:
    """The compiled code of observers and planners, made here if it is not there yet, so that nothing waits for it."""
    what = "compiled kernels"
    try:
        # Here, because the doctor must be able to tell that a package which they need is missing.
        from dlokit.skills.model.quick_kernels import warm as warm_planning
        from dlokit.skills.observer.kernels import warm
    except ImportError as error:
        return Finding(what=what, standing=Standing.ADVICE, found=str(error), mend="pip install dlokit")
    loaded_s = warm() + warm_planning()
    return Finding(what=what, standing=Standing.READY, found=f"compiled, kept on disk, loaded in {loaded_s:.1f} s")


def dependency_findings(distribution: str = "dlokit") -> tuple[Finding, ...]:
    """The packages that dlokit requires, with their versions. Extras are not asked for."""
    try:
        required = [Requirement(line) for line in metadata.requires(distribution) or []]
    except metadata.PackageNotFoundError:
        mend = f"pip install {distribution}"
        return (Finding(what=distribution, standing=Standing.LACKING, found="not installed as a package", mend=mend),)
    own = Finding(what=distribution, standing=Standing.READY, found=metadata.version(distribution))
    return (
        own,
        *(
            package_finding(one, _version)
            for one in required
            if one.marker is None or one.marker.evaluate({"extra": ""})
        ),
    )


def package_finding(required: Requirement, version_of: Callable[[str], str | None]) -> Finding:
    """One required package."""
    mend = f"pip install '{required.name}{required.specifier}'"
    version = version_of(required.name)
    if version is None:
        return Finding(what=required.name, standing=Standing.LACKING, found="not installed", mend=mend)
    if not required.specifier.contains(version, prereleases=True):
        found = f"{version}; {required.specifier} is needed"
        return Finding(what=required.name, standing=Standing.LACKING, found=found, mend=mend)
    return Finding(what=required.name, standing=Standing.READY, found=version)


@dataclass(frozen=True, kw_only=True)
class HardwarePackage:
    """A package that only one kind of hardware needs."""

    name: str
    module: str
    purpose: str
    mend: str


HARDWARE = (
    HardwarePackage(name="franky-control", module="franky", purpose="the FR3 arm", mend="pip install franky-control"),
    HardwarePackage(name="panda-python", module="panda_py", purpose="the Panda arm", mend="pip install panda-python"),
    HardwarePackage(
        name="pyrealsense2", module="pyrealsense2", purpose="RealSense cameras", mend="pip install pyrealsense2"
    ),
    HardwarePackage(
        name="visiontransfer",
        module="visiontransfer",
        purpose="SceneScan stereo cameras",
        mend="install it from the camera's maker: https://nerian.com/support/software/",
    ),
    HardwarePackage(
        name="aravis",
        module="gi",
        purpose="GenICam cameras",
        mend="sudo apt install gir1.2-aravis-0.8 python3-gi",
    ),
)
"""Optional packages of hardware drivers."""


def hardware_finding(package: HardwarePackage, importable: Callable[[str], bool]) -> Finding:
    """One optional package."""
    if importable(package.module):
        return Finding(what=package.name, standing=Standing.READY, found=f"for {package.purpose}")
    found = f"only needed for {package.purpose}"
    return Finding(what=package.name, standing=Standing.OPTIONAL, found=found, mend=package.mend)


def browser_finding(which: Callable[[str], str | None]) -> Finding:
    """A Chromium, which the browser tests drive. People may look at the viewer with any browser."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = which(name)
        if path is not None:
            return Finding(what="chromium", standing=Standing.READY, found=path)
    found = "only needed for the browser tests"
    return Finding(what="chromium", standing=Standing.OPTIONAL, found=found, mend="sudo apt install chromium")


def _usable_cores() -> int:
    """Cores this process may run on, which a container limits below what the machine has."""
    if sys.platform.startswith("linux"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _version(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def _importable(module: str) -> bool:
    """Whether a module is there, without running it: drivers may reach for their device on import."""
    if module == "gi":
        return _aravis_there()
    return find_spec(module) is not None


def _aravis_there() -> bool:
    """Whether GObject introspection finds aravis."""
    if find_spec("gi") is None:
        return False
    gi = import_module("gi")  # optional, and not on every system
    try:
        gi.require_version("Aravis", "0.8")
    except ValueError:
        return False
    return True
