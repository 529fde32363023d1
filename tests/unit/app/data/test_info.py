"""`dlokit info` and the options of recording."""

from dataclasses import replace
from pathlib import Path

import pytest
from made_results import PROTECTED, made_action, made_run
from mcap.writer import Writer

from dlokit.app.commands import execute, parse
from dlokit.app.shape.shape import ShapeArgs
from dlokit.communication import topics
from dlokit.errors import CommunicationError, InputError
from dlokit.extras.bench.commands.shaping import ShapingArgs
from dlokit.recording.channels import CALLS_BEGUN, FILE_NAME, SKILL_CALLS
from dlokit.recording.reader import read_recording
from dlokit.recording.writer import RecordingWriter
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.results.parts_of_run import changed_settings
from dlokit.system.results.run_result import write_result
from dlokit.types.flow import FlowStatus, RunOutcome
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
    judged = CallRecord(
        stamp_ns=9, began_ns=9, seq=3, call=4, skill="planning.judge_goal", outcome=CallEnd.SUCCEEDED, reason=""
    )
    writer.add(SKILL_CALLS, 2_010_000_000, judged)
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
        "│ planning.judge_goal │ – │ – │ 1 succeeded │",
        "│ robot.grasp │ 1.00 │ 1.50 │ 1 succeeded, 1 failed slipped │",
    ):
        assert expected in printed
    assert "truncated" not in printed


def test_info_has_the_settings_that_the_report_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = replace(
        RunConfig(), start="random", seed=3, headless=True, planning=PlanningConfig(strategy=FarthestConfig())
    )
    metadata = {"configuration": {"config.toml": to_toml(config)}}
    RecordingWriter(tmp_path / FILE_NAME, metadata).close()
    assert execute(["info", str(tmp_path)]) == 0
    changed = changed_settings(config)
    assert list(changed) == ["start", "seed", "headless", "planning.strategy"]
    listed = ", ".join(f"{path} {value}" for path, value in changed.items())
    assert f"settings that differ from the defaults: {listed}" in " ".join(capsys.readouterr().out.split())


def recorded_run(folder: Path, config: RunConfig, version: str = "0.1.0") -> Path:
    """The folder of a run with this configuration, without messages."""
    folder.mkdir()
    metadata = {"versions": {"dlokit": version, "numpy": "2"}, "configuration": {"config.toml": to_toml(config)}}
    RecordingWriter(folder / FILE_NAME, metadata).close()
    return folder


def test_of_two_runs_info_prints_the_results_side_by_side_and_each_setting_that_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = replace(RunConfig(), seed=3)
    slow = replace(usual, gate=replace(usual.gate, speed_scale=0.5), planning=PlanningConfig(strategy=FarthestConfig()))
    first = recorded_run(tmp_path / "20261129-170013-random-to-S", usual)
    second = recorded_run(tmp_path / "20261129-170225-random-to-S", slow, version="0.2.0")
    write_result(first, made_run((made_action(1, "lay-down", true_rmse_m=0.008),), rmse_m=0.0077, true_rmse_m=0.008))
    write_result(second, made_run((), outcome=RunOutcome.STALLED, rmse_m=0.0211))

    assert execute(["info", str(first), str(second)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    rows = [[cell.strip() for cell in line.strip("│┃ ").replace("┃", "│").split("│")] for line in lines]
    assert ["", first.name, second.name] in rows or [first.name, second.name] in rows
    for row in (
        ["outcome", "converged", "stalled"],
        ["RMSE, estimated", "7.7 mm", "21.1 mm"],
        ["RMSE, true", "8.0 mm", "–"],
        ["actions", "1", "0"],
        ["time on the run's clock", "30.0 s", "30.0 s"],
        ["gate.speed_scale", "1", "0.5"],
        ["planning.strategy", "rollout", "farthest"],
        ["dlokit", "0.1.0", "0.2.0"],
    ):
        assert row in rows, row
    assert not [row for row in rows if row[0] in ("seed", "numpy")]


def test_two_runs_that_were_not_judged_are_compared_by_their_recordings(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    other = recorded_run(tmp_path_factory.mktemp("others") / "other", replace(RunConfig(), seed=3))
    assert execute(["info", str(folder), str(other / FILE_NAME)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "│ outcome │ not ended │ not ended │" in printed
    assert "│ actions │ 2 │ – │" in printed
    assert "settings that differ: none" in printed
    with pytest.raises(InputError, match="of one run"):
        execute(["info", str(folder), str(other), "--configuration"])


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
