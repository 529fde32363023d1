"""One worker process for heavy, pure work, so that the event loop goes on beating."""

import logging
import multiprocessing
import os
import threading
from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import ParamSpec, TypeVar

from dlokit.communication.compute import PoolCompute
from dlokit.errors import SkillFailure

log = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")


class WorkerCompute:
    """A compute port whose worker starts with the first task; most components have none."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``, computed in the worker.

        A worker that dies meanwhile is replaced, and the work, which is pure, done once more. Raises `SkillFailure`
        ``worker_died`` when the second one dies of it too.
        """
        pool = self._running_pool()
        try:
            return await PoolCompute(pool)(function, *args, **kwargs)
        except BrokenProcessPool:
            log.warning("the worker has died; another one does its work once more")
        self._forget(pool)
        pool = self._running_pool()
        try:
            return await PoolCompute(pool)(function, *args, **kwargs)
        except BrokenProcessPool as error:
            self._forget(pool)
            raise SkillFailure("worker_died", "two worker processes have died of this work") from error

    def _running_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            spawn = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(1, mp_context=spawn, initializer=end_with_parent)
        return self._pool

    def _forget(self, pool: ProcessPoolExecutor) -> None:
        pool.shutdown(wait=False)
        if self._pool is pool:  # another task may have replaced it already
            self._pool = None

    def close(self) -> None:
        """Take no more tasks; what runs is finished, what waits is dropped."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def worker_pool() -> Generator[WorkerCompute]:
    """A compute port whose worker ends with the process that owns it, however that ends."""
    compute = WorkerCompute()
    try:
        yield compute
    finally:
        compute.close()


def end_with_parent() -> None:
    """In a process of `multiprocessing`: end when the one that started it has ended, however it did."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "only a worker is initialised by this"
    # The queue that a worker waits on has no end when its owner is killed; the owner's sentinel has.
    threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
