"""Freed memory goes back to the machine while a process runs."""

import os
import subprocess
import sys
import threading

import pytest

from dlokit.communication.timing.urgency import may_be_urgent
from dlokit.system.processes import freed_memory
from dlokit.system.processes.freed_memory import freed_memory_returned

WAIT_S = 30.0
"""The first return takes 0.01 s; only a failing test waits this long."""
PICTURES = """
from dlokit.system.processes.freed_memory import return_freed_memory

def memory_mb():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1e3

before_mb = memory_mb()
pictures, kept = [], []
for _ in range(800):
    pictures.append(bytearray(100_000))
    kept.append(bytearray(600))  # behind each picture, so that no heap can become shorter
del pictures
print(memory_mb() - before_mb)
return_freed_memory()
print(memory_mb() - before_mb)
"""
"""Frees 80 MB of pictures. Prints what the process still has of them, before and after the return [MB]."""


CYCLES = """
import gc, weakref
from dlokit.system.processes.freed_memory import return_freed_memory

class Page:
    def __init__(self):
        self.itself = self

gc.disable()
for freeze in (lambda: None, gc.freeze):
    freeze()
    page = weakref.ref(Page())
    return_freed_memory()
    print(page() is None)
"""
"""Prints whether a return collects garbage: before the objects of the process are frozen, and after."""


@pytest.mark.live
def test_garbage_is_collected_before_but_only_where_it_is_short() -> None:
    printed = subprocess.run((sys.executable, "-c", CYCLES), capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["False", "True"]


@pytest.mark.live
def test_freed_pictures_go_back_to_the_machine_while_small_objects_behind_them_remain() -> None:
    printed = subprocess.run((sys.executable, "-c", PICTURES), capture_output=True, text=True, check=True).stdout
    kept_mb, left_mb = map(float, printed.split())
    assert kept_mb > 60.0  # the C library keeps nearly all of the 80 MB
    assert left_mb < 20.0  # 4 MB: the small objects, and parts of pages beside them


def test_memory_is_returned_until_the_context_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    returned, before = threading.Event(), set(threading.enumerate())
    monkeypatch.setattr(freed_memory, "return_freed_memory", returned.set)
    with freed_memory_returned(every_s=0.01):
        assert returned.wait(WAIT_S)
        (thread,) = set(threading.enumerate()) - before
    thread.join(WAIT_S)
    assert not thread.is_alive()


@pytest.mark.skipif(not may_be_urgent(), reason="this system allows no real-time priority; see dlokit doctor")
def test_a_return_is_urgent_as_heartbeats_wait_for_the_locks_that_it_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    policies: list[int] = []
    returned = threading.Event()

    def note() -> None:
        policies.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)
        returned.set()

    monkeypatch.setattr(freed_memory, "return_freed_memory", note)
    with freed_memory_returned(every_s=0.01):
        assert returned.wait(WAIT_S)
    assert set(policies) == {os.SCHED_RR}
