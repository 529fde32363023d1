"""The compute port of a live process: a worker process for heavy, pure work, killed and replaced when it is frozen."""

import asyncio
import ctypes
import logging
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any, ParamSpec, TypeVar

import psutil

from dlokit.errors import SkillFailure

log = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

BEAT_EVERY_S = 0.25
SILENT_S = 10.0
"""A worker whose thread gives no sign of life for so long is frozen; one that works hard still gives them."""
LOOK_EVERY_S = 0.5


class Worker:
    """A process that does one task after the other. It starts with the first, and ends with its owner."""

    def __init__(self) -> None:
        spawn = multiprocessing.get_context("spawn")
        # Memory that both see: a pipe would fill up while its reader is busy.
        pid: Any = spawn.RawValue(ctypes.c_longlong, 0)
        beat_s: Any = spawn.RawValue(ctypes.c_double, 0.0)
        self._pool = ProcessPoolExecutor(1, mp_context=spawn, initializer=_begin, initargs=(pid, beat_s))
        # A daemon: while the interpreter ends it waits for the worker, and this one still watches.
        self._no_more = threading.Event()
        watched = (pid, beat_s, self._no_more)
        threading.Thread(target=_watch, args=watched, name="watches the worker", daemon=True).start()

    async def do(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``. Raises `BrokenProcessPool` when the worker dies, or is frozen."""
        return await asyncio.wrap_future(self._pool.submit(function, *args, **kwargs))

    def shut_down(self, *, drop: bool = False) -> None:
        """Take no more tasks; what runs is finished, and what waits as well unless it is to be dropped."""
        self._no_more.set()
        self._pool.shutdown(wait=False, cancel_futures=drop)


def _watch(pid: Any, beat_s: Any, no_more: threading.Event) -> None:
    """Kill the worker when it is frozen; its pool then says that it is broken."""
    while pid.value == 0:  # it starts with the first task
        time.sleep(LOOK_EVERY_S)
    try:
        worker = psutil.Process(int(pid.value))
        while time.monotonic() - beat_s.value < SILENT_S:
            time.sleep(LOOK_EVERY_S)
        if worker.is_running():  # and did not end as it should
            if not no_more.is_set():  # else it may be about to end, and does its work no more
                log.warning("the worker, process %d, is frozen; it is killed", worker.pid)
            worker.kill()
    except psutil.NoSuchProcess:
        return


def end_with_parent() -> None:
    """In a process of `multiprocessing`: end when the one that started it has ended, however it did."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "only a worker is initialised by this"
    # The queue that a worker waits on has no end when its owner is killed; the owner's sentinel has.
    threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _begin(pid: Any, beat_s: Any) -> None:
    end_with_parent()
    threading.Thread(target=_beat, args=(beat_s,), daemon=True).start()
    beat_s.value = time.monotonic()
    pid.value = os.getpid()


def _beat(beat_s: Any) -> None:
    while True:
        beat_s.value = time.monotonic()  # one clock for all processes of a machine
        time.sleep(BEAT_EVERY_S)


def _exit_after(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


class WorkerCompute:
    """A compute port whose worker starts with the first task; most components have none."""

    def __init__(self) -> None:
        self._worker: Worker | None = None

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``, computed in the worker.

        A worker that dies or freezes meanwhile is replaced, and the work, which is pure, done once more. Raises
        `SkillFailure` ``worker_died`` when the second one dies of it too.
        """
        worker = self._present()
        try:
            return await worker.do(function, *args, **kwargs)
        except BrokenProcessPool:
            log.warning("the worker has died; another one does its work once more")
        self._forget(worker)
        worker = self._present()
        try:
            return await worker.do(function, *args, **kwargs)
        except BrokenProcessPool as error:
            self._forget(worker)
            raise SkillFailure("worker_died", "two worker processes have died of this work") from error

    def _present(self) -> Worker:
        if self._worker is None:
            self._worker = Worker()
        return self._worker

    def _forget(self, worker: Worker) -> None:
        worker.shut_down()
        if self._worker is worker:  # another task may have replaced it already
            self._worker = None

    def close(self) -> None:
        """Take no more tasks; what runs is finished, what waits is dropped."""
        if self._worker is not None:
            self._worker.shut_down(drop=True)


@contextmanager
def worker_pool() -> Generator[WorkerCompute]:
    """A compute port whose worker ends with the process that owns it, however that ends."""
    compute = WorkerCompute()
    try:
        yield compute
    finally:
        compute.close()
