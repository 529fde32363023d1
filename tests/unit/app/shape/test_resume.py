"""Runs that can be resumed, and the errors of those that cannot."""

import os
from pathlib import Path

import numpy as np
import pytest

from dlokit.app.shape.resume import resumed_job
from dlokit.decision.journal import Journal
from dlokit.decision.records import GoalRequest
from dlokit.description.shapes import builtin_shape
from dlokit.errors import InputError
from dlokit.recording.disk import Disk
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.processes.running import announced
from dlokit.system.processes.sockets import LocalBus
from dlokit.system.results.run_folder import JournalFile
from dlokit.system.results.run_result import RunResult, write_result
from dlokit.types.flow import RunOutcome

CONFIG = RunConfig(runtime="live", headless=True, seed=7)
LEFT = builtin_shape("I", CONFIG.cell.dlo.length_m, 21) + np.array([0.01, 0.02, 0.1])
JOURNAL = Journal(
    request=GoalRequest(nodes_world=builtin_shape("S", 0.5, 21), name="/home/me/S.csv"),
    errors_m=(0.08, 0.04),
    marks=(),
    slips=(),
    elapsed_s=30.0,
    planning_time_s=2.0,
)


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """The folder of a run that was killed."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "config.toml").write_text(to_toml(CONFIG), encoding="utf-8")
    disk = Disk()
    JournalFile(folder, disk).keep(JOURNAL)
    assert disk.settle()
    np.savez(folder / "truth.npz", stamps_ns=np.array([0, 1]), nodes_world=np.array([LEFT - 0.01, LEFT]))
    return folder


def ended(folder: Path, outcome: RunOutcome) -> None:
    write_result(
        folder,
        RunResult(
            outcome=outcome, actions=1, rmse_m=0.04, threshold_m=0.012, seed=7, sim_time_s=1.0, wall_time_s=1.0,
            planning_time_s=1.0, config_hash="", version="",
        ),
    )  # fmt: skip


def test_a_killed_run_resumes_with_its_goal_and_the_dlo_of_its_cell(run_dir: Path) -> None:
    config, job = resumed_job(run_dir)
    assert config == CONFIG
    assert job.name == "to S.csv, resumed"
    assert job.resumed is not None
    assert job.resumed.actions == 1
    np.testing.assert_array_equal(job.start_nodes_world, LEFT)


@pytest.mark.parametrize("outcome", RunOutcome)
def test_only_a_run_that_ended_normally_is_refused(run_dir: Path, outcome: RunOutcome) -> None:
    ended(run_dir, outcome)
    if outcome in (RunOutcome.FAILED, RunOutcome.CANCELLED):
        assert resumed_job(run_dir)[1].resumed is not None
        return
    with pytest.raises(InputError, match=f"has ended as {outcome.value}"):
        resumed_job(run_dir)


def test_a_run_that_still_runs_is_refused(run_dir: Path) -> None:
    bus = LocalBus(namespace="dlokit/x", folder=run_dir)
    with announced(run_dir, bus), pytest.raises(InputError, match="still running"):
        resumed_job(run_dir)


@pytest.mark.parametrize(
    ("missing", "said"), [("journal.msgpack", "has no journal.msgpack"), ("truth.npz", "where the cell left its DLO")]
)
def test_missing_files_are_named_with_the_command_for_a_new_run(run_dir: Path, missing: str, said: str) -> None:
    os.remove(run_dir / missing)
    with pytest.raises(InputError, match=said) as error:
        resumed_job(run_dir)
    assert "dlokit shape --config" in str(error.value)


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a folder"):
        resumed_job(tmp_path / "nowhere")
