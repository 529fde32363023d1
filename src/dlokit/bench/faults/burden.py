"""Processes that keep the machine busy, and end with the one that started them."""

import multiprocessing
from collections.abc import Generator
from contextlib import contextmanager

from dlokit.system.processes.workers import end_with_parent


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
