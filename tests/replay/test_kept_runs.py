"""Runs that an earlier version left are resumed, read, exported, viewed, and repeated from their `config.toml`."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import dlokit
from dlokit.app.commands import execute
from dlokit.app.shape.resume import resumed_job
from dlokit.recording.channels import FILE_NAME
from dlokit.skills.viewer.playback import MarkKind
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.renamed import RENAMED
from dlokit.system.configuration.toml_config import read_toml, to_toml
from dlokit.system.results.run_result import read_result
from dlokit.system.watching import RecordedRun
from dlokit.types.flow import RunOutcome

KEPT = Path(__file__).with_name("kept")
ADDED = (
    '\n[ros2]\npublish = false\nframe = "base_link"\nlink = "dlokit"\n',
    'beside = ""\n',
    "[installation]\nfixtures = []\n\n",
)
"""The settings that were added since, with the values that change nothing."""


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    return Path(shutil.copytree(KEPT / "killed", tmp_path / "killed"))


@pytest.mark.parametrize("name", ["killed", "ended"])
def test_its_configuration_is_read_and_written_as_it_was_but_for_the_present_names(name: str) -> None:
    file = KEPT / name / CONFIG_FILE
    text = file.read_text(encoding="utf-8")
    for earlier, present in RENAMED.items():
        text = text.replace(f"\n{earlier.rpartition('.')[2]} = ", f"\n{present.rpartition('.')[2]} = ")
    written = to_toml(read_toml(file, RunConfig))
    for added in ADDED:
        written = written.replace(added, "")
    assert written == text


def test_its_result_is_read() -> None:
    result = read_result(KEPT / "ended")
    assert result.outcome is RunOutcome.CONVERGED
    assert [action.kind for action in result.history] == ["pair"]
    assert result.history[0].prediction_error_m == pytest.approx(0.00265, abs=1e-5)  # `missed_m` in the file


def test_its_recording_is_described_and_exported(killed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["info", str(killed)]) == 0
    assert "last step: " in capsys.readouterr().out
    assert execute(["export", str(killed), "--to", "npz", "--out", str(killed / "tables")]) == 0
    recording = dlokit.open_run(killed)
    with np.load(killed / "tables" / "model_state.npz") as table:
        assert len(table["stamp_ns"]) == len(recording.state.nodes_world) > 10


def test_it_is_resumed_with_the_shape_that_it_left(killed: Path) -> None:
    config, job = resumed_job(killed)
    assert config.runtime == "live"
    assert job.request is not None
    assert job.request.name == "S"
    with np.load(killed / "truth.npz") as truth:
        np.testing.assert_allclose(job.start_nodes_world[:, :2], truth["nodes_world"][-1][:, :2], atol=1e-9)


def test_it_is_viewed(killed: Path) -> None:
    timeline = RecordedRun(killed / FILE_NAME).player.timeline
    assert timeline.duration_s > 20.0
    assert timeline.of(MarkKind.ACTION)


def test_it_is_repeated_from_its_configuration(killed: Path) -> None:
    again = ("--runtime", "lockstep", "--no-record", "--max-actions", "1", "--out", str(killed / "again"))
    soon = ("--no-check-camera", "--cell.settle-s", "0.5", "--planning.strategy.search.rollouts", "160")
    assert execute(["shape", "--config", str(killed / CONFIG_FILE), *again, *soon]) == 0
    assert read_result(killed / "again").outcome is RunOutcome.CONVERGED
