"""Output and exit codes of `dlokit replay`; tests/replay tests the replay itself."""

import re
from pathlib import Path

import pytest

from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.writer import RecordingWriter
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.types.system import ClockTick

REFERENCE = Path(__file__).parents[3] / "replay" / "references" / "farthest.mcap"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run with only the clock recorded."""
    metadata = {"configuration": {"config.toml": to_toml(RunConfig())}}
    writer = RecordingWriter(tmp_path / FILE_NAME, metadata)
    writer.add(topics.CLOCK, 0, ClockTick(stamp_ns=0, seq=1))
    writer.close()
    return tmp_path


def test_an_equal_replay_exits_with_0_and_has_a_row_for_every_field(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert execute(["replay", str(REFERENCE), "--into", "observer"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    # Deviations and tolerances depend on the processor that made the reference.
    assert "│ observer/targets │ nodes_world │ 11 │ " in printed
    assert "│ observer.initialise │ result.health │" in printed
    assert "observer reproduces the recording: every field is within its tolerance." in printed


def test_a_different_replay_exits_with_1_and_names_the_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "other.toml"
    config.write_text(to_toml(RunConfig()).replace('kind = "map"', 'kind = "spr"', 1).partition("[observer.str")[0])
    with config.open("a") as file:
        file.write('[observer.strategy]\nkind = "spr"\n')
    assert execute(["replay", str(REFERENCE), "--into", "observer", "--config", str(config)]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "outside its tolerance: observer/targets nodes_world: " in printed
    assert re.search(r"observer/targets nodes_world: 0\.\d+, allowed 1e-0\d \(recorded with ", printed)


def test_a_component_without_data_is_refused(run: Path) -> None:
    with pytest.raises(InputError, match="has no data of planning"):
        execute(["replay", str(run), "--into", "planning"])


def test_a_recording_without_a_configuration_is_refused(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    writer.add(topics.CLOCK, 0, ClockTick(stamp_ns=0, seq=1))
    writer.close()
    with pytest.raises(InputError, match=r"has no configuration of its run; give the recording\.mcap"):
        execute(["replay", str(tmp_path / "a.mcap"), "--into", "model"])


def test_a_recording_without_a_message_is_refused(tmp_path: Path) -> None:
    metadata = {"configuration": {"config.toml": to_toml(RunConfig())}}
    RecordingWriter(tmp_path / "a.mcap", metadata).close()
    with pytest.raises(InputError, match="has no data of observer"):
        execute(["replay", str(tmp_path / "a.mcap"), "--into", "observer"])
