"""The folder of a sweep of faults."""

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from dlokit.errors import InputError
from dlokit.system.config import RunConfig
from parts.faults.judging import RunFinding
from parts.faults.sweep import claim_faults_folder, run_faults
from parts.faults.table import BY_NAME
from parts.faults.trial import FINDING_FILE, FaultCase, finished


def test_the_folder_of_an_interrupted_sweep_is_continued_and_that_of_another_is_refused(tmp_path: Path) -> None:
    config = RunConfig()
    claim_faults_folder(tmp_path, config)
    claim_faults_folder(tmp_path, config)
    with pytest.raises(InputError, match="other settings"):
        claim_faults_folder(tmp_path, replace(config, seed=7))


def test_a_finished_run_is_read_and_not_run_again(tmp_path: Path) -> None:
    case = FaultCase(fault=BY_NAME["kill-camera"], number=3)
    found = RunFinding(fault="kill-camera", number=3, struck=True, exit_code=0)
    (tmp_path / case.folder_name).mkdir()
    (tmp_path / case.folder_name / FINDING_FILE).write_bytes(msgspec.json.encode(found))
    assert list(run_faults([case], RunConfig(), tmp_path)) == [(case, found)]


def test_a_run_that_never_started_is_repeated_by_the_next_sweep(tmp_path: Path) -> None:
    (tmp_path / FINDING_FILE).write_bytes(
        msgspec.json.encode(RunFinding(fault="kill-camera", number=3, broken="not_started"))
    )
    assert finished(tmp_path) is None
