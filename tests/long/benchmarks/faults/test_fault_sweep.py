"""The runs of a sweep of faults, and its folder."""

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from dlokit.errors import ConfigError, InputError
from faults import claim_faults_folder, faults_named, found
from parts.faults.judging import RunFinding
from parts.faults.table import BY_NAME, FAULTS
from parts.faults.trial import FINDING_FILE, FaultCase, cases, finished


def test_the_folder_of_an_interrupted_sweep_is_continued_and_that_of_another_is_refused(tmp_path: Path) -> None:
    claim_faults_folder(tmp_path, 0)
    claim_faults_folder(tmp_path, 0)
    with pytest.raises(InputError, match="another seed"):
        claim_faults_folder(tmp_path, 7)


def test_a_finished_run_is_read_and_not_run_again(tmp_path: Path) -> None:
    case = FaultCase(fault=BY_NAME["kill-camera"], number=3)
    finding = RunFinding(fault="kill-camera", number=3, struck=True, exit_code=0)
    (tmp_path / FINDING_FILE).write_bytes(msgspec.json.encode(finding))
    assert found(case, tmp_path) == finding


def test_a_run_that_never_started_is_repeated_by_the_next_sweep(tmp_path: Path) -> None:
    (tmp_path / FINDING_FILE).write_bytes(
        msgspec.json.encode(RunFinding(fault="kill-camera", number=3, broken="not_started"))
    )
    assert finished(tmp_path) is None


def test_faults_are_chosen_by_name_and_an_unknown_one_is_refused() -> None:
    assert faults_named("") == FAULTS
    assert faults_named("kill-camera, none") == (BY_NAME["none"], BY_NAME["kill-camera"])
    with pytest.raises(ConfigError, match="'kill-cat' is unknown; choose from none, kill-decision"):
        faults_named("kill-cat")


def test_a_full_suite_has_more_than_150_runs_and_each_a_folder_of_its_own() -> None:
    folders = [case.folder_name for case in cases(FAULTS, 8, 0)]
    assert len(folders) > 150
    assert len(set(folders)) == len(folders)


def test_the_runs_of_a_fault_take_each_moment_and_each_task() -> None:
    fault = replace(FAULTS[0], when=FAULTS[1].when)
    drawn = {(case.moment, case.config.start) for case in cases((fault,), 2 * len(fault.when), 0)}
    assert len(drawn) == 2 * len(fault.when)


def test_a_run_is_watched_by_a_viewer_where_its_fault_is_the_viewers() -> None:
    for case in cases(FAULTS, 1, 0):
        assert case.config.headless == ("viewer" not in case.fault.name)
