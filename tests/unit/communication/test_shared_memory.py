"""A machine without shared memory is named as the cause, before processes that need it start."""

from pathlib import Path

import pytest

from dlokit.app.doctor.machine import Severity, shared_memory_finding
from dlokit.communication.zenoh.session import check_shared_memory
from dlokit.errors import MachineError


def test_a_folder_that_can_be_written_passes_and_stays_empty(tmp_path: Path) -> None:
    check_shared_memory(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "cause"), [("none", "No such file or directory"), ("file/none", "Not a directory")])
def test_the_cause_and_the_ways_out_are_named(name: str, cause: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(MachineError, match=rf"{name} cannot be written \({cause}\).*docker run --shm-size") as caught:
        check_shared_memory(str(tmp_path / name))
    assert "lockstep runs without it" in str(caught.value)


def test_doctor_has_a_row_for_it(tmp_path: Path) -> None:
    assert shared_memory_finding(lambda: check_shared_memory(str(tmp_path))).standing is Severity.READY
    lacking = shared_memory_finding(lambda: check_shared_memory(str(tmp_path / "none")))
    assert lacking.standing is Severity.ADVICE
    assert "none cannot be written" in lacking.found
    assert "lockstep" in lacking.fix
