"""A worker that dies or freezes is replaced, and its work is repeated."""

import asyncio
import os
import signal
import threading
import time
from pathlib import Path

import psutil
import pytest
from transport_grid import eventually

from dlokit.errors import SkillFailure
from dlokit.system.processes import freed_memory
from dlokit.system.processes.workers import SILENT_S, worker_pool

pytestmark = pytest.mark.live


def die_unless(done_before: Path) -> int:
    if not done_before.exists():
        done_before.touch()
        os._exit(1)
    return os.getpid()


def freeze_unless(done_before: Path) -> int:
    if not done_before.exists():
        done_before.touch()
        os.kill(os.getpid(), signal.SIGSTOP)
    return os.getpid()


def work_for_ever(begun: Path) -> None:
    begun.touch()
    while True:
        time.sleep(1.0)


def thread_names() -> list[str]:
    return [thread.name for thread in threading.enumerate()]


def die() -> None:
    os._exit(1)


def test_another_worker_does_the_work_of_one_that_dies(tmp_path: Path) -> None:
    async def main() -> None:
        with worker_pool() as compute:
            # Both: the second task waits in the pool that breaks.
            first, second = await asyncio.gather(compute(die_unless, tmp_path / "mark"), compute(os.getpid))
            assert first == second != os.getpid()

    asyncio.run(main())


def test_another_worker_does_the_work_of_one_that_freezes(tmp_path: Path) -> None:
    later_s = 0.0

    async def main() -> None:
        nonlocal later_s
        with worker_pool(lambda: time.monotonic() + later_s) as compute:
            frozen = await compute(os.getpid)
            done = asyncio.create_task(compute(freeze_unless, tmp_path / "mark"))
            await eventually(lambda: psutil.Process(frozen).status() == psutil.STATUS_STOPPED)
            later_s = SILENT_S  # only for this one: the next may be slow on a busy machine
            await eventually(lambda: not psutil.pid_exists(frozen))
            later_s = 0.0
            assert await done != frozen

    asyncio.run(main())


def test_work_that_kills_every_worker_fails_by_name_and_the_next_work_is_done() -> None:
    async def main() -> None:
        with worker_pool() as compute:
            with pytest.raises(SkillFailure, match="worker_died"):
                await compute(die)
            assert await compute(os.getpid) != os.getpid()

    asyncio.run(main())


def test_what_a_terminal_sends_to_all_processes_interrupts_no_worker() -> None:
    async def main() -> None:
        with worker_pool() as compute:
            worker = await compute(os.getpid)
            for number in (signal.SIGINT, signal.SIGHUP):
                os.kill(worker, number)
            assert await compute(os.getpid) == worker

    asyncio.run(main())


def test_a_worker_that_is_busy_ends_with_its_owner(tmp_path: Path) -> None:
    async def main() -> None:
        with worker_pool() as compute:
            worker = psutil.Process(await compute(os.getpid))
            working = asyncio.create_task(compute(work_for_ever, tmp_path / "begun"))
            await eventually((tmp_path / "begun").exists)
            working.cancel()
        await eventually(lambda: not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE)

    asyncio.run(main())


def test_a_worker_returns_the_memory_that_it_has_freed() -> None:
    async def main() -> None:
        with worker_pool() as compute:
            assert freed_memory.THREAD in await compute(thread_names)

    asyncio.run(main())
