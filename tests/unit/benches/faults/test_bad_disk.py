"""The file system of a case whose disk fails."""

import os
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from dlokit.benches.faults import disks
from dlokit.benches.faults.disks import MOUNT, BadDisk, DiskFault
from dlokit.errors import ProcessFailure

pytestmark = pytest.mark.skipif(BadDisk(what=DiskFault.FULL).unable() != "", reason="only root may mount")


def test_a_disk_is_unmounted_when_the_last_process_has_closed_its_files(tmp_path: Path) -> None:
    with BadDisk(what=DiskFault.FULL).mounted(tmp_path) as place:
        used = (place / "used").open("w")
        closing = threading.Timer(0.3, used.close)
        closing.start()
    assert not os.path.ismount(tmp_path / MOUNT)
    closing.join()


def test_a_disk_that_stays_in_use_is_detached_and_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disks, "CLOSED_WITHIN_S", 0.2)
    with (
        ExitStack() as files,
        pytest.raises(ProcessFailure, match="disk_in_use"),
        BadDisk(what=DiskFault.FULL).mounted(tmp_path) as place,
    ):
        files.enter_context((place / "used").open("w"))
    assert not os.path.ismount(tmp_path / MOUNT)
