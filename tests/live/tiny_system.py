"""Tables and launches of tiny processes; run as a program, a tiny system that waits until it is stopped."""

import asyncio
import sys
from contextlib import AbstractAsyncContextManager
from pathlib import Path

from dlokit.errors import ProcessFailure
from dlokit.system.live import LiveSystem, live_system, namespace_of
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import NEVER, ProcessRow, Restart, TimeBase

OWN = ProcessRow(name="main", components=())
CELL = ProcessRow(name="cell", components=("cell",), time_base=TimeBase.MACHINE, outlives_s=2.0)
BROKEN = ProcessRow(name="lamp", components=("broken",), after=("cell",))
UNPLUGGED = ProcessRow(name="socket", components=("unplugged",), after=("cell",))


def echo_row(*, essential: bool = True, restart: Restart = NEVER, silent_for_s: float = 10.0) -> ProcessRow:
    return ProcessRow(
        name="echo",
        components=("echo",),
        after=("cell",),
        essential=essential,
        restart=restart,
        silent_for_s=silent_for_s,
    )


def tiny_system(run_dir: Path, *rows: ProcessRow) -> AbstractAsyncContextManager[LiveSystem]:
    launch = Launch(
        namespace=namespace_of(run_dir),
        config_file=run_dir / "config.toml",
        run_dir=run_dir,
        command=(sys.executable, str(Path(__file__).with_name("tiny_process.py"))),
    )
    return live_system((OWN, CELL, *rows), launch)


async def for_ever(run_dir: Path) -> None:
    async with tiny_system(run_dir, echo_row()) as live:
        print(*live.supervisor.pids.values(), flush=True)
        await live.run(asyncio.Event().wait(), lambda result, failure: result)


if __name__ == "__main__":
    try:
        asyncio.run(for_ever(Path(sys.argv[1])))
    except (KeyboardInterrupt, asyncio.CancelledError):
        sys.exit(130)
    except ProcessFailure as failure:
        sys.exit(str(failure))
