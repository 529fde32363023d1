import pytest

from dlokit.errors import ProcessFailure
from dlokit.system.config import RunConfig
from dlokit.system.processes.supervisor import (
    STARTED_WITHIN_S,
    may_restart,
    recent_restarts,
    start_failure,
    start_waves,
)
from dlokit.system.table import NEVER, ProcessRow, Restart, processes_of_run


def row(name: str, *after: str) -> ProcessRow:
    return ProcessRow(name=name, components=(), after=after)


def names(*rows: ProcessRow) -> list[list[str]]:
    return [[each.name for each in wave] for wave in start_waves(rows)]


def test_processes_start_together_unless_one_waits_for_another() -> None:
    assert names(row("a"), row("b", "c"), row("c"), row("d", "b")) == [["a", "c"], ["b"], ["d"]]


def test_a_process_does_not_wait_for_one_that_is_not_part_of_the_system() -> None:
    assert names(row("robot", "cell"), row("viewer")) == [["robot", "viewer"]]


def test_the_arm_and_the_camera_of_a_simulated_cell_start_after_it_and_so_end_before_it() -> None:
    waves = names(*processes_of_run(RunConfig()))
    assert "cell" in waves[0]
    assert set(waves[1]) == {"robot", "camera"}


def test_processes_that_wait_for_one_another_are_named() -> None:
    with pytest.raises(ProcessFailure, match=r"\['a', 'b'\] wait for one another"):
        names(row("a", "b"), row("b", "a"), row("c"))


def test_a_process_is_restarted_as_often_as_its_row_allows_within_the_window() -> None:
    twice = Restart(times=2, window_s=60.0, wait_s=1.0)
    assert may_restart(twice, [0.0], 10.0)
    assert may_restart(twice, [0.0, 10.0], 20.0)
    assert not may_restart(twice, [0.0, 10.0, 20.0], 30.0)
    assert may_restart(twice, [0.0, 10.0, 20.0], 75.0)
    assert not may_restart(NEVER, [0.0], 1e6)


def test_only_restarts_within_the_window_make_the_next_one_wait_longer() -> None:
    policy = Restart(times=3, window_s=60.0, wait_s=1.0)
    assert recent_restarts(policy, [0.0], 10.0) == 0
    assert recent_restarts(policy, [0.0, 10.0, 20.0], 30.0) == 2
    assert recent_restarts(policy, [0.0, 10.0, 20.0], 75.0) == 1


@pytest.mark.parametrize(
    ("silent_s", "for_s", "why"),
    [
        (119.0, 119.0, ""),
        (0.5, 600.0, ""),  # it still compiles
        (121.0, 121.0, "no sign of life for 120 s"),
        (121.0, 300.0, "no sign of life for 120 s"),
        (0.5, STARTED_WITHIN_S + 1.0, "not ready within 900 s"),
    ],
)
def test_a_start_goes_on_as_long_as_it_is_heard_of_but_not_for_ever(silent_s: float, for_s: float, why: str) -> None:
    assert start_failure(row("observer"), silent_s, for_s) == why
