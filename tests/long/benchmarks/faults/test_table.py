"""The table of faults, and the runs that it makes."""

from dataclasses import replace

from dlokit.system.config import RunConfig
from dlokit.system.table import PROCESSES, Needed
from parts.faults.table import FAULTS
from parts.faults.trial import cases


def test_every_process_of_a_run_with_one_arm_is_killed_and_frozen() -> None:
    names = {fault.name for fault in FAULTS}
    for row in PROCESSES:
        if row.needed is not Needed.TWO_ARMS:
            assert {f"kill-{row.name}", f"freeze-{row.name}"} <= names


def test_a_full_suite_has_more_than_150_runs_and_each_a_folder_of_its_own() -> None:
    folders = [case.folder_name for case in cases(FAULTS, 8)]
    assert len(folders) > 150
    assert len(set(folders)) == len(folders)


def test_the_runs_of_a_fault_take_each_moment_and_each_task() -> None:
    fault = replace(FAULTS[0], when=FAULTS[1].when)
    drawn = {(case.moment, case.config(RunConfig()).start) for case in cases((fault,), 2 * len(fault.when))}
    assert len(drawn) == 2 * len(fault.when)


def test_a_run_is_watched_by_a_viewer_where_its_fault_is_the_viewers() -> None:
    for case in cases(FAULTS, 1):
        assert case.config(RunConfig()).headless == ("viewer" not in case.fault.name)
