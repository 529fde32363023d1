"""Freed memory goes back to the machine while a process runs."""

import subprocess
import sys

HOLDS_AND_FREES = """
import time
from dlokit.system.processes.freed_memory import freed_memory_returned

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
with freed_memory_returned(every_s=0.01):
    end_s = time.monotonic() + 20.0
    while memory_mb() - before_mb > 20.0 and time.monotonic() < end_s:
        time.sleep(0.01)
print(memory_mb() - before_mb)
"""
"""Frees 80 MB of pictures. Prints the memory that it then has, and what it has after the returns [MB]."""


def test_freed_pictures_go_back_to_the_machine_while_small_objects_behind_them_remain() -> None:
    said = subprocess.run((sys.executable, "-c", HOLDS_AND_FREES), capture_output=True, text=True, check=True).stdout
    freed_mb, returned_mb = map(float, said.split())
    assert freed_mb > 60.0  # the C library keeps them
    assert returned_mb < 20.0


def test_no_return_follows_the_end_of_its_context() -> None:
    code = """
import threading
from dlokit.system.processes.freed_memory import freed_memory_returned
before = threading.active_count()
with freed_memory_returned(every_s=0.01):
    assert threading.active_count() == before + 1
[thread.join(5.0) for thread in threading.enumerate() if thread is not threading.main_thread()]
assert threading.active_count() == before
"""
    subprocess.run((sys.executable, "-c", code), check=True, timeout=60.0)
