"""The file system of a case whose disk fails."""

import os
from contextlib import ExitStack
from pathlib import Path

import pytest

from parts.faults.disks import MOUNT, BadDisk, DiskFault

pytestmark = pytest.mark.skipif(BadDisk(what=DiskFault.FULL).unable() != "", reason="only root may mount")


def test_a_disk_is_unmounted_while_a_file_on_it_is_still_open(tmp_path: Path) -> None:
    with ExitStack() as files, BadDisk(what=DiskFault.FULL).mounted(tmp_path) as place:
        files.enter_context((place / "used").open("w"))
    assert not os.path.ismount(tmp_path / MOUNT)
