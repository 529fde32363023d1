"""The log of a process: no line waits for the disk, and its size is bounded."""

import io
import logging
import threading
from pathlib import Path

from dlokit.system.processes.child import WAITING_LINES, AsideHandler
from dlokit.system.processes.report import bound_log

HANGS_S = 60.0
"""On a busy machine the thread that writes may stand still for seconds."""


class SlowDisk(io.StringIO):
    """A stream that hangs until it is let go, or refuses lines."""

    def __init__(self) -> None:
        super().__init__()
        self.responds = threading.Event()
        self.refuses = False

    def write(self, text: str) -> int:
        self.responds.wait()
        if self.refuses:
            raise OSError(28, "No space left on device")
        return super().write(text)


def line(text: str) -> logging.LogRecord:
    return logging.LogRecord("lamp", logging.INFO, __file__, 1, text, None, None)


def test_lines_are_queued_while_the_disk_hangs_and_dropped_lines_are_counted() -> None:
    stream = SlowDisk()
    handler = AsideHandler(stream, HANGS_S)
    for number in range(WAITING_LINES + 100):
        handler.emit(line(str(number)))  # returns
    stream.responds.set()
    handler.close()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "0"
    dropped = sum(int(text[1:].split()[0]) for text in lines if "were dropped" in text)
    assert dropped + len([text for text in lines if text.isdigit()]) == WAITING_LINES + 100


def test_a_full_disk_loses_lines_and_not_the_thread_that_writes() -> None:
    stream = SlowDisk()
    stream.refuses = True
    stream.responds.set()
    handler = AsideHandler(stream, HANGS_S)
    handler.emit(line("lost"))
    while handler.waiting:
        pass
    stream.refuses = False
    handler.emit(line("kept"))
    handler.close()
    assert "kept" in stream.getvalue()


def test_a_log_that_grows_too_large_begins_again_while_its_process_writes(tmp_path: Path) -> None:
    path = tmp_path / "robot.log"
    with path.open("ab", buffering=0) as process:
        process.write(b"a" * 100)
        bound_log(path, 100)
        process.write(b"b")
        assert not (tmp_path / "robot.log.1").exists()
        bound_log(path, 100)
        process.write(b"c")
    assert path.read_bytes() == b"c"
    assert (tmp_path / "robot.log.1").read_bytes() == b"a" * 100 + b"b"
