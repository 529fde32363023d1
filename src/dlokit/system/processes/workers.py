"""The compute port of a live process: a worker process for heavy pure functions, replaced when it is frozen."""

import asyncio
import ctypes
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from multiprocessing.connection import wait
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

import psutil

from dlokit.errors import SkillFailure
from dlokit.system.processes.freed_memory import start_returning
from dlokit.system.signals import OF_TERMINAL, terminal_signals_blocked

log = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

BEAT_EVERY_S = 0.25
SILENT_S = 10.0
"""A worker without a heartbeat for this long is frozen [s]; a busy worker still sends heartbeats."""
LOOK_EVERY_S = 0.5


class Worker:
    """A process that executes one task after the other. It starts with the first, and ends with its owner."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        """`now_s` is the clock of this process, which all processes of a machine share."""
        spawn = multiprocessing.get_context("spawn")
        # Shared memory: a pipe would fill up while its reader is busy.
        pid: Any = spawn.RawValue(ctypes.c_longlong, 0)
        beat_s: Any = spawn.RawValue(ctypes.c_double, 0.0)
        self._pool = ProcessPoolExecutor(1, mp_context=spawn, initializer=_begin, initargs=(pid, beat_s))
        self._started, self._pid = False, pid
        # A daemon thread: at its exit the interpreter waits for the worker, which this thread must still watch.
        self._no_more = threading.Event()
        watched = (pid, beat_s, self._no_more, now_s)
        threading.Thread(target=_watch, args=watched, name="watches the worker", daemon=True).start()

    async def do(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``. Raises `BrokenProcessPool` when the worker dies, or is frozen."""
        with nullcontext() if self._started else _for_a_worker():
            self._started = True
            future = self._pool.submit(function, *args, **kwargs)
        return await asyncio.wrap_future(future)

    def shut_down(self) -> None:
        """Accept no more tasks; those that it has are finished."""
        self._no_more.set()
        self._pool.shutdown(wait=False)

    def kill(self) -> None:
        """End it, and drop its tasks: no caller waits for their results."""
        self._no_more.set()
        self._pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            if child.pid == self._pid.value:  # 0 before it has begun
                child.kill()


@contextmanager
def _for_a_worker() -> Generator[None]:
    """Protect processes that start while the context is open from interrupts, and from running the calling script.

    `multiprocessing` runs the script in its processes: without ``if __name__ == "__main__"``, a script that starts a
    system would start another one there. The worker does not need the script: its tasks are functions of dlokit.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        with terminal_signals_blocked():
            yield
    finally:
        sys.modules["__main__"] = script


def _watch(pid: Any, beat_s: Any, no_more: threading.Event, now_s: Callable[[], float]) -> None:
    """Kill a frozen worker; its pool then reports that it is broken."""
    while pid.value == 0:  # the worker starts with the first task
        time.sleep(LOOK_EVERY_S)
    try:
        worker = psutil.Process(int(pid.value))
        while now_s() - beat_s.value < SILENT_S:
            time.sleep(LOOK_EVERY_S)
        if worker.is_running():  # and has not ended correctly
            if not no_more.is_set():  # otherwise it may be ending and has no more tasks
                log.warning("the worker, process %d, is frozen; it is killed", worker.pid)
            worker.kill()
    except psutil.NoSuchProcess:
        return


def end_with_parent() -> None:
    """In a process of `multiprocessing`: end whenever the parent process has ended, even by a kill."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "only a worker is initialised by this"
    # The queue of a worker does not end when its owner is killed; the owner's sentinel does.
    threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _begin(pid: Any, beat_s: Any) -> None:
    end_with_parent()
    for number in OF_TERMINAL:  # blocked so far
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_beat, args=(beat_s,), daemon=True).start()
    start_returning(threading.Event())
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
    """A compute port that starts its worker with the first task; most components need none."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        """`now_s` is the clock that measures a worker's silence."""
        self._now_s = now_s
        self._worker: Worker | None = None

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``, computed in the worker.

        A worker that dies or freezes is replaced, and the task, a pure function, is repeated once. Raises
        `SkillFailure` ``worker_died`` when the second worker dies too.
        """
        worker = self._present()
        try:
            return await worker.do(function, *args, **kwargs)
        except BrokenProcessPool:
            log.warning("the worker has died; a new worker repeats its task")
        self._forget(worker)
        worker = self._present()
        try:
            return await worker.do(function, *args, **kwargs)
        except BrokenProcessPool as error:
            self._forget(worker)
            raise SkillFailure("worker_died", "two worker processes died while executing this task") from error

    def _present(self) -> Worker:
        if self._worker is None:
            self._worker = Worker(self._now_s)
        return self._worker

    def _forget(self, worker: Worker) -> None:
        worker.shut_down()
        if self._worker is worker:  # another task may have replaced it already
            self._worker = None

    def close(self) -> None:
        """End the worker, even during a task."""
        if self._worker is not None:
            self._worker.kill()


@contextmanager
def worker_pool(now_s: Callable[[], float] = time.monotonic) -> Generator[WorkerCompute]:
    """A compute port whose worker always ends with its owner process, even after a kill."""
    compute = WorkerCompute(now_s)
    try:
        yield compute
    finally:
        compute.close()
