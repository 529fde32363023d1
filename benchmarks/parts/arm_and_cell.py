"""A live system of cell and arms alone, on a machine that may be kept busy."""

import multiprocessing
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from dlokit.description.shapes import CURVE_POINTS, builtin_shape
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.live_system import LiveSystem, live_system, namespace_of
from dlokit.system.processes.supervisor import PROCESS, Launch
from dlokit.system.processes.workers import end_with_parent
from dlokit.system.results.run_folder import write_config, write_start
from dlokit.system.table import CELL, ROBOT, SECOND, ProcessRow


@contextmanager
def burden(processes: int) -> Generator[None]:
    """As many busy processes meanwhile."""
    context = multiprocessing.get_context("spawn")
    busy = [context.Process(target=_burn, daemon=True, name=f"burden {i}") for i in range(processes)]
    for process in busy:
        process.start()
    try:
        yield
    finally:
        for process in busy:
            process.kill()
        for process in busy:
            process.join()


def _burn() -> None:
    end_with_parent()
    number = 1
    while True:
        number = number * 1664525 % 4294967291


OWN = ProcessRow(name="main", components=())


@asynccontextmanager
async def arm_and_cell(
    folder: Path, run: RunConfig, *others: ProcessRow, command: tuple[str, ...] = PROCESS
) -> AsyncGenerator[LiveSystem]:
    """The cell, with a straight DLO, a process for each arm of `run`, and `others`; `folder` is the run's.

    `command` starts each of the processes.
    """
    dlo = run.cell.dlo
    write_start(folder, builtin_shape("I", dlo.length_m, CURVE_POINTS, radius_m=dlo.radius_m))
    write_config(folder, run)
    launch = Launch(
        namespace=namespace_of(folder),
        config_file=folder / CONFIG_FILE,
        run_dir=folder,
        command=command,
    )
    async with live_system((OWN, CELL, *(ROBOT, SECOND)[: run.arms], *others), launch) as live:
        yield live
