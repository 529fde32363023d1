"""Returns the freed memory of a process to the machine."""

import ctypes
import gc
import threading
from collections.abc import Generator
from contextlib import contextmanager

from dlokit.communication.timing.urgency import WORK_PRIORITY, make_urgent

RETURN_EVERY_S = 30.0
"""Period [s]. A call takes 0.2 to 3 ms, at most 10, and delays only threads that allocate or free memory meanwhile; the
garbage collection before it takes 0.1 ms for each 2,000 objects that are not frozen, and delays all of Python."""
THREAD = "returns freed memory"
"""Name of the thread."""


def return_freed_memory() -> None:
    """Return memory that this process has freed, and that its C library still holds, to the machine.

    On its own, glibc returns only the free end of each heap: one small object behind freed pictures keeps all their
    memory, and over hours the heaps grow. Other C libraries have no such function, and the call has no effect there.

    Garbage is collected first where that is quick (`garbage_frozen`): Python itself collects it only every few minutes,
    and until then the memory of closed viewer pages is kept, some 4 MB in three minutes.
    """
    if gc.get_freeze_count():
        gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def start_returning(over: threading.Event, every_s: float = RETURN_EVERY_S) -> None:
    """Return freed memory every `every_s` [s] from a thread of its own, until `over` is set or the process ends.

    The thread is urgent: it holds the interpreter's lock or the locks of the heaps, for which heartbeats wait. An
    ordinary thread can lose its core then: next to a busy process and a browser, heartbeats were up to 0.8 s late.
    """

    def work() -> None:
        make_urgent(WORK_PRIORITY)
        while not over.wait(every_s):
            return_freed_memory()

    threading.Thread(target=work, name=THREAD, daemon=True).start()


@contextmanager
def freed_memory_returned(every_s: float = RETURN_EVERY_S) -> Generator[None]:
    """Return freed memory every `every_s` [s] while the context is open."""
    over = threading.Event()
    start_returning(over, every_s)
    try:
        yield
    finally:
        over.set()
