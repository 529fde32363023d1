"""A live system of cell and robot alone: what the arm does when its commander is lost, or a person stops it."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from dlokit.description.shapes import builtin_shape
from dlokit.system.build import instances_of_run
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.live import LiveSystem, live_system, namespace_of
from dlokit.system.processes.supervisor import PROCESS, Launch
from dlokit.system.results.run_folder import write_start
from dlokit.system.table import CELL, OPPOSITE, ROBOT, ProcessRow
from dlokit.system.toml_config import to_toml

OWN = ProcessRow(name="bench", components=())


@asynccontextmanager
async def arm_and_cell(run: RunConfig, folder: Path, command: tuple[str, ...] = PROCESS) -> AsyncGenerator[LiveSystem]:
    """The cell, with a straight DLO, and a process for each arm of `run`; `folder` is the run's.

    `command` starts each of the processes.
    """
    dlo = run.cell.dlo
    write_start(folder, builtin_shape("I", dlo.length_m, 101, radius_m=dlo.radius_m))
    config_file = folder / CONFIG_FILE
    config_file.write_text(to_toml(run), encoding="utf-8")
    launch = Launch(
        namespace=namespace_of(folder),
        config_file=config_file,
        run_dir=folder,
        instances=instances_of_run(run),
        command=command,
    )
    arms = (ROBOT, OPPOSITE)[: run.arms]
    async with live_system((OWN, CELL, *arms), launch) as live:
        yield live
