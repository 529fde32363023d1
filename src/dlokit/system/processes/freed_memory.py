"""Freed memory of a process, returned to the machine."""

import ctypes
import threading
from collections.abc import Generator
from contextlib import contextmanager

RETURN_EVERY_S = 30.0
"""Period of the returns [s]; one takes 0.2 to 3 ms, seldom 10, and delays only threads that need memory meanwhile."""


def return_freed_memory() -> None:
    """Return what this process has freed, as far as the C library still holds it.

    By itself glibc returns only the end of each heap. A small object behind the memory of freed pictures keeps all of
    it, and over hours of pictures of changing sizes the heaps grow. Other C libraries have no such function.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def return_until(over: threading.Event, every_s: float = RETURN_EVERY_S) -> None:
    """Return freed memory periodically until `over` is set."""
    while not over.wait(every_s):
        return_freed_memory()


@contextmanager
def freed_memory_returned(every_s: float = RETURN_EVERY_S) -> Generator[None]:
    """Return freed memory periodically, from a thread of its own, while the context is open."""
    over = threading.Event()
    threading.Thread(target=return_until, args=(over, every_s), name="returns freed memory", daemon=True).start()
    try:
        yield
    finally:
        over.set()
