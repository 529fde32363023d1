"""How a process of dlokit ends once its work is done; it uses the standard library only."""

import atexit
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def without_teardown() -> Generator[None]:
    """End the process of the block without freeing its memory object by object; for a program's outermost block.

    The interpreter would take 0.2 to 0.5 s of processor time for it after NumPy, Numba and MuJoCo: for the six
    processes of a live run that is most of the time that Ctrl-C took. Threads are joined and exit handlers called as
    always. A block that raises another error than `SystemExit` ends as always.
    """
    codes: list[int] = []

    def leave() -> None:
        if not codes:
            return
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except (OSError, ValueError):  # the interpreter reports it
            return
        os._exit(codes[0])

    atexit.register(leave)  # first, because exit handlers are called in reverse order
    try:
        yield
        codes.append(0)
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            codes.append(end.code or 0)
        raise
