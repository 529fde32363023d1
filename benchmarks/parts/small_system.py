"""A live system of cell and robot alone, on a machine that is kept busy."""

import multiprocessing
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from dlokit.description.shapes import CURVE_POINTS, builtin_shape
from dlokit.system.build import instances_of_run
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.live import LiveSystem, live_system, namespace_of
from dlokit.system.processes.supervisor import PROCESS, Launch
from dlokit.system.processes.workers import end_with_parent
from dlokit.system.results.run_folder import write_start
from dlokit.system.table import CELL, ROBOT, SECOND, ProcessRow
from dlokit.system.toml_config import to_toml


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


OWN = ProcessRow(name="bench", components=())


@asynccontextmanager
async def arm_and_cell(run: RunConfig, folder: Path, command: tuple[str, ...] = PROCESS) -> AsyncGenerator[LiveSystem]:
    """The cell, with a straight DLO, and a process for each arm of `run`; `folder` is the run's.

    `command` starts each of the processes.
    """
    dlo = run.cell.dlo
    write_start(folder, builtin_shape("I", dlo.length_m, CURVE_POINTS, radius_m=dlo.radius_m))
    config_file = folder / CONFIG_FILE
    config_file.write_text(to_toml(run), encoding="utf-8")
    launch = Launch(
        namespace=namespace_of(folder),
        config_file=config_file,
        run_dir=folder,
        instances=instances_of_run(run),
        command=command,
    )
    arms = (ROBOT, SECOND)[: run.arms]
    async with live_system((OWN, CELL, *arms), launch) as live:
        yield live
