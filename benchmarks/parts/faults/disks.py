"""Faults of the disk of a run: a file system of its own that fills up, becomes read-only, hangs, or loses the folder.

Root mounts it; for other users these faults are skipped.
"""

import asyncio
import enum
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from dlokit.types.robot import RobotMode
from parts.faults.injuries import Injury
from parts.live_run import LiveRun

MOUNT = "disk"
"""Folder of a case on which its file system is mounted."""
SIZE_BYTES = 200_000_000
FILLER = "filler"
NEXT_MOTION_S = 30.0
"""Longest wait for the next motion of the arm [s]."""


class DiskFault(enum.Enum):
    """What happens to the disk."""

    FULL = "full"
    READ_ONLY = "read-only"
    """Files that are open for writing stay so, as after an error of the disk; none can be opened any more."""
    DELETED = "deleted"
    """The folder of the run."""
    HANGS = "hangs"
    """Everything that writes waits in the kernel (fsfreeze)."""


@dataclass
class BadDisk(Injury):
    """The disk of a run fails; with `stops_decision` the decision process is stopped meanwhile, at the next motion."""

    what: DiskFault
    left_bytes: int = 0
    """Free space that remains on a full disk [bytes]."""
    stops_decision: bool = False
    _hung: list[Path] = field(default_factory=list[Path])
    _stopped: list[psutil.Process] = field(default_factory=list[psutil.Process])

    def unable(self) -> str:
        """Only root may mount a file system."""
        if os.geteuid() != 0:
            return "only root may mount the file system that fails"
        if self.what is DiskFault.HANGS and (shutil.which("mkfs.ext4") is None or shutil.which("fsfreeze") is None):
            return "this system has no mkfs.ext4 or no fsfreeze"
        return ""

    @contextmanager
    def mounted(self, folder: Path) -> Generator[Path]:
        """The disk of a case, below its folder; what the run left on it is copied into the folder at the end."""
        place, image = folder / MOUNT, folder / "disk.img"
        place.mkdir()
        if self.what is DiskFault.HANGS:
            with image.open("wb") as file:
                file.truncate(SIZE_BYTES)
            _do("mkfs.ext4", "-q", "-F", str(image))
            _do("mount", "-o", "loop,noatime", str(image), str(place))
        else:
            _do("mount", "-t", "tmpfs", "-o", f"size={SIZE_BYTES}", "dlokit-bench", str(place))
        try:
            yield place
        finally:
            self._thaw()
            for run in place.glob("run*"):
                shutil.copytree(run, folder / run.name)
            # Lazily: a process that ends loses its environment, by which the bench knows it, before the kernel closes
            # its files. Whether a process of the run remains is judged for every case.
            _do("umount", "--recursive", "--lazy", str(place))
            image.unlink(missing_ok=True)

    async def inject(self, run: LiveRun) -> float | None:
        """Begin the fault; with `stops_decision` the arm feels it when the decision process is stopped."""
        place = run.folder.parent
        match self.what:
            case DiskFault.FULL:
                await asyncio.to_thread(_fill, place / FILLER, self.left_bytes)
            case DiskFault.READ_ONLY:
                _do("mount", "--bind", str(run.folder), str(run.folder))
                _do("mount", "-o", "remount,bind,ro", str(run.folder))
            case DiskFault.DELETED:
                shutil.rmtree(run.folder)
            case DiskFault.HANGS:
                await asyncio.to_thread(_do, "fsfreeze", "-f", str(place))
                self._hung.append(place)
        if not self.stops_decision:
            return None
        # The disk took its time to stop.
        await run.arm.until_mode(RobotMode.MOVING, after_s=time.monotonic(), within_s=NEXT_MOTION_S)
        self._stopped.append(psutil.Process(run.pid_of("decision")))
        stopped_s = time.monotonic()
        self._stopped[0].send_signal(signal.SIGSTOP)
        return stopped_s

    async def heal(self, run: LiveRun) -> None:
        """Let a disk that hangs respond again; the others do not heal."""
        self._thaw()

    def _thaw(self) -> None:
        while self._hung:
            _do("fsfreeze", "-u", str(self._hung.pop()))
        while self._stopped:
            with suppress(psutil.NoSuchProcess):
                self._stopped.pop().send_signal(signal.SIGCONT)


def _fill(path: Path, left_bytes: int) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT)
    try:
        with suppress(OSError):
            while True:
                os.write(handle, bytes(65536))
        os.truncate(handle, max(os.fstat(handle).st_size - left_bytes, 0))
    finally:
        os.close(handle)


def _do(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=60)
