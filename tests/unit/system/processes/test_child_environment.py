"""The memory that started processes keep, and the threads on which they compute."""

import asyncio
import os
import sys
from pathlib import Path

import pytest

from dlokit.communication.timing.urgency import ONE_THREAD
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.processes.child_process import ChildProcess, ChildSpec, LogFile
from dlokit.system.processes.runtime_folder import RUNTIME_DIR
from dlokit.system.table import TimeBase

pytestmark = pytest.mark.live

ENDS_WITHIN_S = 60.0
"""It takes 0.2 s; only a failing test waits this long."""
PICTURES = """
import threading

def memory_mb():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1e3

def work():
    together.wait()
    with turn:
        for _ in range(3):
            pictures = []
            for _ in range(50):
                pictures.append(bytearray(200_000))
                kept.append(bytearray(600))
            del pictures
    together.wait()

kept, together, turn = [], threading.Barrier(8), threading.Lock()
before_mb = memory_mb()
threads = [threading.Thread(target=work) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(memory_mb() - before_mb)
"""
"""Each of 8 threads takes and frees 10 MB of pictures before the next begins. Prints the memory that stays [MB]."""


THREADS = """
import os, numpy
numpy.ones((200, 200)) @ numpy.ones((200, 200))
print(len(os.listdir("/proc/self/task")))
"""
"""OpenBLAS starts its threads when NumPy is imported."""


def test_the_threads_of_a_process_reuse_the_memory_of_freed_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MALLOC_ARENA_MAX", raising=False)
    kept_mb = float(last_line_of((sys.executable, "-Sc", PICTURES), tmp_path))
    assert kept_mb < 40.0  # 20 MB in two heaps; the 80 MB of all threads with the default of glibc


def test_a_process_keeps_linear_algebra_on_one_thread_unless_the_user_has_set_another_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)
    assert last_line_of((sys.executable, "-c", THREADS), tmp_path) == "1"
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert last_line_of((sys.executable, "-c", THREADS), tmp_path) == "2"


def test_a_process_announces_itself_where_its_parent_does(tmp_path: Path) -> None:
    tells = f"import os; print(os.environ[{RUNTIME_DIR!r}])"
    assert last_line_of((sys.executable, "-Sc", tells), tmp_path) == os.environ[RUNTIME_DIR]


def last_line_of(command: tuple[str, ...], folder: Path) -> str:
    """Run a command as a process of a run; the last line that it prints."""

    async def last_line() -> str:
        log = LogFile(folder / "lamp.log")
        process = ChildProcess(command, spec, log)
        try:
            async with asyncio.timeout(ENDS_WITHIN_S):
                while process.exit_code is None:  # noqa: ASYNC110  a process has no event to wait for
                    await asyncio.sleep(0.01)
            return process.last_line()
        finally:
            await process.stop()
            log.close()

    spec = ChildSpec(
        process="lamp",
        components=(),
        bus=ZenohConfig(namespace="lamp"),
        time_base=TimeBase.MACHINE,
        config_file="",
        run_dir=str(folder),
        page_key="",
        beat_fd=-1,
    )
    return asyncio.run(last_line())
