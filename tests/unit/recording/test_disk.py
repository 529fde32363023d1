"""Files of a run survive power loss, and a disk that fails or hangs delays no caller."""

import os
import threading
from pathlib import Path

import pytest

from dlokit.recording.disk import NO_ANSWER, Disk, write_synced


def full(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_a_file_is_synced_before_it_gets_its_name_and_its_folder_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[str, bool]] = []
    path, sync = tmp_path / "new" / "result.json", os.fsync

    def fsync(handle: int) -> None:
        done.append((Path(os.readlink(f"/proc/self/fd/{handle}")).name, path.exists()))
        sync(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    write_synced(path, b"figures")
    assert path.read_bytes() == b"figures"
    assert done == [("result.json.part", False), ("new", True)]


def test_a_full_disk_leaves_the_previous_file_whole_and_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "result.json"
    write_synced(path, b"before")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_synced(path, b"after")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_no_caller_waits_for_a_disk_that_hangs_and_the_newest_content_is_written() -> None:
    disk, hangs, responds = Disk(), threading.Event(), threading.Event()
    done: list[str] = []

    def hang() -> None:
        hangs.set()
        responds.wait()

    disk.put("journal", hang)
    hangs.wait()
    for number in range(1000):
        disk.put("journal", lambda number=number: done.append(f"journal {number}"))
    disk.put("report", lambda: done.append("report"))
    assert not disk.settle(0.01)
    assert disk.failures == {"journal": NO_ANSWER, "report": NO_ANSWER}
    responds.set()
    assert disk.settle()
    assert done == ["journal 999", "report"]
    assert disk.failures == {}


def test_a_failure_counts_until_the_file_is_written(caplog: pytest.LogCaptureFixture) -> None:
    disk = Disk()
    assert not disk.written("journal", full)
    assert not disk.written("journal", full)
    assert disk.failures == {"journal": "No space left on device"}
    assert len(caplog.records) == 1  # not at each step of a task
    assert disk.written("journal", lambda: None)
    assert disk.failures == {}


def test_a_programming_error_in_one_file_does_not_keep_the_others_from_the_disk() -> None:
    disk = Disk()
    assert not disk.written("report", lambda: 1 // 0)
    assert "ZeroDivisionError" in disk.failures["report"]
    assert disk.written("journal", lambda: None)
