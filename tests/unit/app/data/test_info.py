"""`dlokit info` and the options of recording."""

from pathlib import Path

import pytest
from made_results import PROTECTED
from mcap.writer import Writer

from dlokit.app.commands import execute, parse
from dlokit.app.shape.shape import ShapeArgs
from dlokit.communication import topics
from dlokit.errors import CommunicationError, InputError
from dlokit.extras.bench.commands.shaping import ShapingArgs
from dlokit.recording.channels import CALLS_BEGUN, FILE_NAME, SKILL_CALLS
from dlokit.recording.reader import read_recording
from dlokit.recording.writer import RecordingWriter
from dlokit.types.flow import FlowStatus
from dlokit.types.outcome import CallBegun, CallEnd, CallRecord
from dlokit.types.system import ClockTick


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run of 2 s with two calls, whose flow had not ended."""
    writer = RecordingWriter(
        tmp_path / FILE_NAME,
        {"run": {"name": "I to S"}, "versions": {"dlokit": "0.1.0"}, "configuration": {"config.toml": "seed = 3"}},
    )
    for number in range(1, 202):
        writer.add(topics.CLOCK, number * 10_000_000, ClockTick(stamp_ns=number, seq=number))
    writer.add(topics.FLOW, 2_010_000_000, FlowStatus(stamp_ns=1, seq=1, flow="shape_dlo", step="grasp", actions=2))
    for call, skill in enumerate(("robot.grasp", "robot.grasp", "robot.move_to"), start=1):
        writer.add(CALLS_BEGUN, 2_010_000_000, CallBegun(stamp_ns=1, seq=call, skill=skill, call=call))
    for seq, (end, reason) in enumerate([(CallEnd.SUCCEEDED, ""), (CallEnd.FAILED, "slipped")], start=1):
        call = CallRecord(
            stamp_ns=seq * 1_000_000_000,
            began_ns=500_000_000,
            seq=seq,
            call=seq,
            skill="robot.grasp",
            outcome=end,
            reason=reason,
        )
        writer.add(SKILL_CALLS, 2_010_000_000, call)
    writer.add(topics.PROTECTION, 2_010_000_000, PROTECTED)
    writer.add_metadata("lost", {"robot/state": "4"})
    writer.close()
    return tmp_path


def test_info_prints_duration_run_versions_topics_and_outcomes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["info", str(folder)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for expected in (
        f"{folder / FILE_NAME}: 2.0 s on the run's clock",
        "run: name I to S",
        "versions: dlokit 0.1.0",
        "pictures: not known",
        "settings that differ from the defaults: seed 3",
        "calls that had not ended: robot.move_to",
        "arm first, after a recovery: stops itself at 20 N·m of a joint or 30 N on the tool, load 0.25 kg; it reports "
        "a tool of 0.730 kg at (0.0, 0.0, 103.4) mm from the flange, load 0.250 kg",
        "The file is complete.",
        "last step: grasp, after 2 actions; it had not ended",
        "not recorded, because the disk was slow: robot/state 4",
        "│ cell/clock │ dlokit.ClockTick │ 201 │ 100.0 │ 13 │",
        "│ robot.grasp │ 1.00 │ 1.50 │ 1 succeeded, 1 failed slipped │",
    ):
        assert expected in printed
    assert "truncated" not in printed


def test_info_prints_the_whole_configuration_for_another_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["info", str(folder), "--configuration"]) == 0
    assert capsys.readouterr().out == "seed = 3"


def test_info_reports_that_a_file_was_cut_off(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "cut.mcap"
    path.write_bytes((folder / FILE_NAME).read_bytes()[:-10])
    assert execute(["info", str(path)]) == 0
    assert "The file is truncated" in capsys.readouterr().out


def test_names_and_values_of_a_strange_file_are_printed_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recording_of(tmp_path, "[/red]and[bold", b"{}")
    assert execute(["info", str(path)]) == 0
    assert "[/red]and[bold" in capsys.readouterr().out


@pytest.mark.parametrize("data", [b"[" * 100_000, b"nonsense"])
def test_a_message_that_is_no_json_is_one_clear_error(tmp_path: Path, data: bytes) -> None:
    path = recording_of(tmp_path, SKILL_CALLS.name, data)
    with pytest.raises(CommunicationError, match="not JSON that can be read"):
        execute(["info", str(path)])
    with pytest.raises(CommunicationError, match="not JSON that can be read"):
        list(read_recording(path))


def recording_of(folder: Path, channel: str, data: bytes) -> Path:
    """An MCAP file with one message, which another program has written."""
    path = folder / "strange.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("[schema]", "jsonschema", b"{}")
        writer.add_message(writer.register_channel(channel, "json", schema), log_time=0, publish_time=0, data=data)
        writer.finish()
    return path


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"recording\.mcap cannot be read"):
        execute(["info", str(tmp_path)])


def test_runs_are_recorded_by_default_and_benches_on_request() -> None:
    runs = [parse(arguments) for arguments in (["shape"], ["shape", "--no-record"])]
    assert [run.run.record for run in runs if isinstance(run, ShapeArgs)] == [True, False]
    benches = [parse(["bench", "shaping", *flags]) for flags in ([], ["--record"])]
    assert [bench.run.record for bench in benches if isinstance(bench, ShapingArgs)] == [False, True]
