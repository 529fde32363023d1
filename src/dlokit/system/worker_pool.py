"""One worker process for heavy, pure work, so that the event loop goes on beating."""

import multiprocessing
import os
import threading
from collections.abc import Generator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait

from dlokit.communication.compute import PoolCompute


@contextmanager
def worker_pool() -> Generator[PoolCompute]:
    """A compute port; its worker starts with the first task and ends with the process that owns it."""
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent)
    try:
        yield PoolCompute(pool)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None, "only a worker is initialised by this"
    # The queue that a worker waits on has no end when its owner is killed; the owner's sentinel has.
    threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
