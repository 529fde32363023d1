"""The memory that started processes keep."""

import asyncio
import sys
from pathlib import Path

import pytest

from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.processes.child_process import ChildProcess, ChildSpec, LogFile
from dlokit.system.table import TimeBase

ENDS_WITHIN_S = 30.0
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


def test_the_threads_of_a_process_reuse_the_memory_of_freed_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def last_line() -> str:
        log = LogFile(tmp_path / "lamp.log")
        process = ChildProcess((sys.executable, "-Sc", PICTURES), spec, log)
        try:
            async with asyncio.timeout(ENDS_WITHIN_S):
                while process.exit_code is None:  # noqa: ASYNC110  a process has no event to wait for
                    await asyncio.sleep(0.01)
            return process.last_line()
        finally:
            await process.stop()
            log.close()

    monkeypatch.delenv("MALLOC_ARENA_MAX", raising=False)
    spec = ChildSpec(
        process="lamp",
        components=(),
        bus=ZenohConfig(namespace="lamp"),
        time_base=TimeBase.MACHINE,
        config_file="",
        run_dir=str(tmp_path),
        page_key="",
        beat_fd=-1,
    )
    kept_mb = float(asyncio.run(last_line()))
    assert kept_mb < 40.0  # 20 MB in two heaps; the 80 MB of all threads with the default of glibc
