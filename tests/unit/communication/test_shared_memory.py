"""A machine without shared memory is named as the cause, before processes that need it start."""

import signal
from pathlib import Path

import pytest

from dlokit.app.doctor.machine import Severity, shared_memory_finding
from dlokit.communication.shared_memory import check_shared_memory, start_tracker
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


def test_what_cleans_up_after_a_pool_starts_without_the_signal_of_a_terminal() -> None:
    started: list[bool] = []

    class Tracker:
        def ensure_running(self) -> None:
            started.append(signal.SIGHUP in signal.pthread_sigmask(signal.SIG_BLOCK, ()))

    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    start_tracker(Tracker())
    assert started == [True]
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


def test_doctor_has_a_row_for_it(tmp_path: Path) -> None:
    assert shared_memory_finding(lambda: check_shared_memory(str(tmp_path))).standing is Severity.READY
    lacking = shared_memory_finding(lambda: check_shared_memory(str(tmp_path / "none")))
    assert lacking.standing is Severity.ADVICE
    assert "none cannot be written" in lacking.found
    assert "lockstep" in lacking.fix
