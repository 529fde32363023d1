"""Files that survive power loss, and a thread that writes them: no loop of a run waits for a disk."""

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

log = logging.getLogger(__name__)

DISK_TIMEOUT_S = 10.0
"""Longest wait for a disk at the end of a run [s]."""
NO_ANSWER = "the disk does not respond"


def write_synced(path: Path, data: bytes) -> None:
    """Replace a file: after power loss it is the old one or the new one, whole. Raises `OSError`.

    A folder that was deleted meanwhile is created again.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):  # on a full disk its bytes are needed by the other files
            part.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def reason_of(error: BaseException) -> str:
    """Why a file could not be written, in a few words."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return f"{type(error).__name__}: {error}"


class Disk:
    """Writes the files of a run on a thread of its own. At most one job waits for each file: the newest.

    A job that raises `OSError` does not end the run or the thread; `failures` names its file until a later job for
    the same file succeeds.
    """

    def __init__(self) -> None:
        """The thread starts with the first job."""
        self._changed = threading.Condition()
        self._jobs: dict[str, Callable[[], object]] = {}
        self._working: str | None = None
        self._failures: dict[str, str] = {}
        self._thread: threading.Thread | None = None

    @property
    def failures(self) -> Mapping[str, str]:
        """Files that were not written, each with the reason."""
        with self._changed:
            return dict(self._failures)

    def put(self, name: str, job: Callable[[], object]) -> None:
        """Write a file soon; returns at once. `job` replaces one for the same file that has not begun."""
        with self._changed:
            self._jobs[name] = job
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="disk", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def written(self, name: str, job: Callable[[], object], timeout_s: float = DISK_TIMEOUT_S) -> bool:
        """Write a file now, and wait for the disk, at most `timeout_s`; returns whether it was written."""
        self.put(name, job)
        self.settle(timeout_s)
        return name not in self.failures

    def fail(self, name: str, why: str) -> None:
        """Note that a file of the run, by any writer, is incomplete."""
        with self._changed:
            known = self._failures.get(name)
            self._failures[name] = why
        if known != why:
            log.warning("%s is not written: %s", name, why)

    def settle(self, timeout_s: float = DISK_TIMEOUT_S) -> bool:
        """Wait until all jobs are done, at most `timeout_s`; the files of unfinished jobs count as failed."""
        end_s = time.monotonic() + timeout_s
        with self._changed:
            while (self._jobs or self._working is not None) and (left_s := end_s - time.monotonic()) > 0.0:
                self._changed.wait(left_s)
            late = [*self._jobs, *([] if self._working is None else [self._working])]
        for name in late:
            self.fail(name, NO_ANSWER)
        return not late

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._jobs:
                    self._working = None
                    self._changed.notify_all()
                    self._changed.wait()
                self._working = name = next(iter(self._jobs))
                job = self._jobs.pop(name)
            try:
                job()
            except Exception as error:  # the thread must write the other files
                self.fail(name, reason_of(error))
            else:
                with self._changed:
                    self._failures.pop(name, None)
