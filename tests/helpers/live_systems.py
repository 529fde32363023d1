"""What live tests share: a loop for a system that several tests use, the command line, and the processes of a run."""

import asyncio
import itertools
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Generator
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import psutil

from dlokit.errors import InputError
from dlokit.system.results.run_folder import read_journal

T = TypeVar("T")

DLOKIT = str(Path(sys.executable).with_name("dlokit"))
HANGS_S = 300.0
"""What takes longer hangs [s]: a live run takes half a minute of two idle cores, a start some seconds."""
LOOK_S = 0.02
"""Pause between looks at what has no event, such as the end of another's process [s]."""


def started_by(pid: int) -> dict[str, psutil.Process]:
    """The processes of the system that process `pid` has started, by name, without their workers."""
    children = (child for child in psutil.Process(pid).children() if child.status() != psutil.STATUS_ZOMBIE)
    return {line[-1]: child for child in children if "dlokit.system.processes.main" in (line := child.cmdline())}


async def eventually(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds that nobody reports."""
    async with asyncio.timeout(HANGS_S):
        for _ in itertools.count():
            if condition():
                return
            await asyncio.sleep(LOOK_S)


class Background:
    """An event loop in a thread of its own, on which a system runs on between tests."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """The result of a coroutine on the loop."""

        async def limited() -> T:
            async with asyncio.timeout(HANGS_S):
                return await coroutine

        return asyncio.run_coroutine_threadsafe(limited(), self._loop).result()

    @contextmanager
    def entered(self, context: AbstractAsyncContextManager[T]) -> Generator[T]:
        """Enter a context on the loop, and leave it in the same task at the end."""
        began, end = Future[T](), asyncio.Event()

        async def hold() -> None:
            try:
                async with context as value:
                    began.set_result(value)
                    await end.wait()
            except BaseException as error:
                if began.done():
                    raise
                began.set_exception(error)

        holding = asyncio.run_coroutine_threadsafe(hold(), self._loop)
        try:
            yield began.result(HANGS_S)
        finally:
            self._loop.call_soon_threadsafe(end.set)
            holding.result(HANGS_S)


@contextmanager
def background() -> Generator[Background]:
    """Provide a loop within the context."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="systems of tests")
    thread.start()
    try:
        yield Background(loop)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def runs(pid: int) -> bool:
    """Whether a process runs, and is not only to be reaped."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def wait_until(condition: Callable[[], bool], program: "subprocess.Popen[Any]") -> None:
    """Wait until a condition holds that nobody reports, while a program runs."""
    end_s = time.monotonic() + HANGS_S
    while not condition():
        assert program.poll() is None, "the program has ended"
        assert time.monotonic() < end_s
        time.sleep(LOOK_S)


def has_looked(run: Path) -> bool:
    """Whether the task of a run has seen its DLO."""
    try:
        return bool(read_journal(run).errors_m)
    except InputError:
        return False
