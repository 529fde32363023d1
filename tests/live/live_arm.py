"""A live system of the cell and one arm, each in its own process."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from dlokit.description.shapes import builtin_shape
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.live_system import LiveSystem, live_system, namespace_of
from dlokit.system.processes.supervisor import PROCESS, Launch
from dlokit.system.results.run_folder import write_start
from dlokit.system.table import CELL, ROBOT, ProcessRow
from dlokit.system.toml_config import to_toml

OWN = ProcessRow(name="main", components=())


@asynccontextmanager
async def arm_and_cell(
    folder: Path, config: RunConfig, *others: ProcessRow, command: tuple[str, ...] = PROCESS
) -> AsyncGenerator[LiveSystem]:
    """The two and `others`, started by `command`; `folder` is the run's."""
    write_start(folder, builtin_shape("I", config.cell.dlo.length_m, 101, radius_m=config.cell.dlo.radius_m))
    (folder / CONFIG_FILE).write_text(to_toml(config), encoding="utf-8")
    launch = Launch(namespace=namespace_of(folder), config_file=folder / CONFIG_FILE, run_dir=folder, command=command)
    async with live_system((OWN, CELL, ROBOT, *others), launch) as live:
        yield live
