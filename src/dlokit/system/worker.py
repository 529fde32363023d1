"""One worker process, and whether it is alive: one that is frozen is killed, so that nobody waits for it for ever."""

import asyncio
import ctypes
import logging
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import wait
from typing import Any, ParamSpec, TypeVar

import psutil

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
