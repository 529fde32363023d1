"""`dlokit doctor`: check this machine for what dlokit needs."""

import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import psutil
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.app.doctor.installation import PICTURE_FORMATS, draw_installation, installation_findings
from dlokit.app.doctor.machine import (
    DoctorRow,
    Severity,
    browser_finding,
    cores_finding,
    dependency_findings,
    device_findings,
    importable,
    kernels_finding,
    memory_finding,
    opengl_finding,
    port_finding,
    python_finding,
    shared_memory_finding,
    urgency_finding,
    usable_cores,
)
from dlokit.app.doctor.opengl import probe_opengl
from dlokit.communication.timing.urgency import may_be_urgent
from dlokit.errors import EXIT_BAD_INPUT, InputError, install_command


@dataclass(frozen=True, kw_only=True)
class DoctorArgs:
    """Check this machine for what dlokit needs, and print the commands that fix what is missing.

    `dlokit doctor franka` checks a Franka before its first run, with an operator beside it; `dlokit doctor ros2` checks
    the connection to ROS 2, and finds the settings of its cameras.
    """

    installation: Annotated[Path | None, flag("FILE")] = None
    """Check this installation file instead of the machine: arms, home, reach, the camera's view, and the age of its
    calibration."""
    picture: Annotated[Path | None, flag("FILE")] = None
    """With `--installation`: draw its cell, from the side and as its camera sees it, to this .png or .jpg file."""
    viewer_host: str = "127.0.0.1"
    """Address on which the viewer would listen."""
    port: int = 8080
    """Port on which the viewer would listen."""
    opengl_timeout_s: float = 60.0
    """Time limit for rendering one small picture [s]."""


def run(args: DoctorArgs) -> int:
    """Print the findings. Returns 0 when everything required is present, else 2."""
    console = Console()
    if args.installation is not None:
        return _check_installation(args.installation, args.picture, console)
    if args.picture is not None:
        raise InputError("--picture draws the cell of an installation: add --installation FILE.")
    findings = examine(args)
    console.print(findings_table(findings, "dlokit doctor"))
    if lacking := _lacking(findings):
        console.print(f"[bold red]dlokit cannot run here yet:[/] {', '.join(lacking)}.", highlight=False)
        return EXIT_BAD_INPUT
    if importable("mujoco"):
        console.print("[bold green]dlokit can run here.[/] Try: dlokit demo", highlight=False)
    else:
        console.print(
            f"[bold green]dlokit can track here.[/] To shape as well: {escape(install_command('all'))}", highlight=False
        )
    return 0


def _check_installation(file: Path, picture: Path | None, console: Console) -> int:
    if picture is not None and picture.suffix not in PICTURE_FORMATS:
        raise InputError(f"--picture is {picture}; its name must end in {' or '.join(PICTURE_FORMATS)}.")
    findings = installation_findings(file)
    console.print(findings_table(findings, f"installation {file.name}"))
    if picture is not None:
        draw_installation(file, picture)
        say(console, f"picture: {picture}")
    if wrong := _lacking(findings):
        console.print(f"[bold red]The installation cannot work yet:[/] {', '.join(wrong)}.", highlight=False)
        return EXIT_BAD_INPUT
    console.print("[bold green]The installation can work.[/] `dlokit doctor` checks the machine.", highlight=False)
    return 0


def examine(args: DoctorArgs) -> tuple[DoctorRow, ...]:
    """Check everything, in the order of the table."""
    return (
        python_finding(sys.version_info[:3]),
        opengl_finding(probe_opengl(args.opengl_timeout_s) if importable("mujoco") else None),
        cores_finding(usable_cores()),
        urgency_finding(may_be_urgent()),
        memory_finding(psutil.virtual_memory().available / 2**30),
        shared_memory_finding(),
        port_finding(args.viewer_host, args.port),
        *dependency_findings(),
        kernels_finding(),
        *device_findings(),
        browser_finding(shutil.which),
    )


def _lacking(findings: Sequence[DoctorRow]) -> list[str]:
    return [finding.what for finding in findings if finding.standing is Severity.LACKING]


def findings_table(findings: Sequence[DoctorRow], title: str) -> Table:
    """The findings as a table; commands are not wrapped, so that they can be copied."""
    styles = {
        Severity.READY: "green",
        Severity.LACKING: "bold red",
        Severity.ADVICE: "yellow",
        Severity.OPTIONAL: "dim",
        Severity.SKIPPED: "yellow",
    }
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("what", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("found", overflow="fold")
    table.add_column("to fix it", overflow="fold")
    for finding in findings:
        standing = Text(finding.standing.value, style=styles[finding.standing])
        table.add_row(finding.what, standing, Text(finding.found), Text(finding.fix, style="cyan"))
    return table


COMMAND = CliCommand(DoctorArgs, run)
