"""Tables and launches of tiny processes."""

import sys
from contextlib import AbstractAsyncContextManager
from dataclasses import replace
from pathlib import Path

from dlokit.system.live_system import LiveSystem, live_system, namespace_of
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import ProcessRow, Restart, TimeBase

OWN = ProcessRow(name="main", components=())
CELL = ProcessRow(name="cell", components=("cell",), time_base=TimeBase.MACHINE)
AGAIN = Restart(times=1, window_s=3600.0, wait_s=0.1)
ECHO = ProcessRow(name="echo", components=("echo",), after=("cell",), restart=AGAIN)
OTHER = ProcessRow(name="other", components=("other",), after=("cell",), restart=AGAIN, essential=False)


def alone(component: str) -> ProcessRow:
    """A process that needs no cell."""
    return ProcessRow(name=component, components=(component,), time_base=TimeBase.MACHINE)


def tiny_system(run_dir: Path, *rows: ProcessRow, own: ProcessRow = OWN) -> AbstractAsyncContextManager[LiveSystem]:
    launch = Launch(
        namespace=namespace_of(run_dir),
        config_file=run_dir / "config.toml",
        run_dir=run_dir,
        command=(sys.executable, str(Path(__file__).with_name("tiny_process.py"))),
    )
    return live_system((own, *rows), launch)


def empty_system(run_dir: Path) -> AbstractAsyncContextManager[LiveSystem]:
    """A system whose only process is this one."""
    return tiny_system(run_dir, own=replace(OWN, time_base=TimeBase.MACHINE))
