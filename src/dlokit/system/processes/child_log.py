"""The log of a started process, written by a thread of its own: a disk that hangs delays no loop."""

import logging
import queue
import sys
import threading
from typing import TextIO

WAITING_LINES = 1000
"""Largest number of lines that wait for the disk; further ones are counted instead."""
CLOSES_WITHIN_S = 1.0
"""Longest wait for the last lines at the end of the process [s]."""


class AsideHandler(logging.Handler):
    """Formats lines where they are logged, and writes them on a thread."""

    def __init__(self, stream: TextIO, closes_within_s: float = CLOSES_WITHIN_S) -> None:
        super().__init__()
        self._closes_within_s = closes_within_s
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(WAITING_LINES)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of lines that are not written yet."""
        return self._lines.unfinished_tasks

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a line; returns at once."""
        try:
            self._lines.put_nowait(self.format(record))
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Write what waits, unless the disk does not respond."""
        super().close()
        if self._thread.is_alive():
            try:
                self._lines.put(None, timeout=self._closes_within_s)
            except queue.Full:
                return
            self._thread.join(self._closes_within_s)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            dropped, self._dropped = self._dropped, 0
            if dropped:
                line = f"{line}\n({dropped} lines before this one were dropped: the disk was too slow)"
            try:
                self._stream.write(f"{line}\n")
                self._stream.flush()
            except OSError:
                self._dropped += 1 + dropped  # a full disk: the lines are lost, the process is not
            self._lines.task_done()


def log_aside() -> None:
    """Log to standard error from now on, without waiting for it."""
    handler = AsideHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
