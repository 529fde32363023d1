"""The samples of a soak: what each process of the system uses, every 2.3 seconds, as a line of JSON.

It runs in a process of its own, because reading the memory maps of all processes takes time and memory, which would
count as the system's. Arguments: the process id of the soak, the process id of its load or 0, and the file. It samples
at once, and ends when its standard input is closed.
"""

import os
import select
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import msgspec
import psutil

from dlokit.system.processes.supervisor import PROCESS

SAMPLE_EVERY_S = 2.3
"""Often: with samples seven seconds apart, a worker's least memory in five minutes was 117 or 128 MB by chance. And no
divisor of the 30 s after which processes return freed memory: a block would have many samples soon after they return
it, or none."""


class ProcessUse(msgspec.Struct, frozen=True):
    """What a process uses."""

    name: str
    pid: int
    memory: float
    """Memory of its own [MB]: pages that processes share do not count."""
    descriptors: int
    threads: int


class Sample(msgspec.Struct, frozen=True):
    """What all processes of a system use at one time."""

    time_s: float
    """Time since the first sample [s]."""
    shared_mb: float
    """Shared memory of all processes together [MB]."""
    load: float
    """Load of the machine."""
    processes: list[ProcessUse]


def take_sample(soak: psutil.Process, others: Sequence[int], time_s: float) -> Sample:
    """Measure the process of the soak and all its children, without `others` and theirs."""
    family = [soak, *(each for child in soak.children() if child.pid not in others for each in _with_children(child))]
    found = (_measured(process, soak.pid) for process in family)
    return Sample(
        time_s=round(time_s, 1),
        shared_mb=_shared_bytes(family) / 1e6,
        load=os.getloadavg()[0],
        processes=[use for use in found if use is not None],
    )


def _with_children(process: psutil.Process) -> list[psutil.Process]:
    with suppress(psutil.Error):
        return [process, *process.children(recursive=True)]
    return []


def _measured(process: psutil.Process, soak: int) -> ProcessUse | None:
    try:
        # Where the system does not tell which pages are shared, all pages of the process count.
        memory = process.memory_full_info().uss / 1e6
        return ProcessUse(_name_of(process, soak), process.pid, memory, process.num_fds(), process.num_threads())
    except psutil.Error:
        return None


def _name_of(process: psutil.Process, soak: int) -> str:
    if process.pid == soak:
        return "decision"
    command = process.cmdline()
    return command[-1] if PROCESS[-1] in command else f"worker {process.pid}"


def _shared_bytes(family: Sequence[psutil.Process]) -> int:
    """Shared memory that any of these processes has mapped; what several have mapped counts once."""
    largest: dict[str, int] = {}
    for process in family:
        mapped: Counter[str] = Counter()
        with suppress(OSError):
            for line in Path(f"/proc/{process.pid}/maps").read_text(encoding="utf-8").splitlines():
                addresses, _, _, _, inode, *name = line.split(maxsplit=5)
                if name and name[0].startswith("/dev/shm/"):
                    begin, end = (int(one, 16) for one in addresses.split("-"))
                    mapped[inode] += end - begin
        for inode, size in mapped.items():
            largest[inode] = max(largest.get(inode, 0), size)
    return sum(largest.values())


def main(soak: psutil.Process, load: int, file: Path) -> None:
    """Sample again and again, until the standard input is closed."""
    began_s = time.monotonic()
    with file.open("wb", buffering=0) as out:
        while True:
            sample = take_sample(soak, (load, os.getpid()), time.monotonic() - began_s)
            out.write(msgspec.json.encode(sample) + b"\n")
            if select.select([sys.stdin], [], [], SAMPLE_EVERY_S)[0]:
                return


if __name__ == "__main__":
    main(psutil.Process(int(sys.argv[1])), int(sys.argv[2]), Path(sys.argv[3]))
