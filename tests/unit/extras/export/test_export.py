"""`dlokit export`: the exported data equal the recorded data."""

import csv
import importlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damaged_recordings import chunks_of, cut_after, with_a_wrong_bit
from installed_packages import install
from made_results import made_run

from dlokit.app.commands import execute
from dlokit.errors import EXIT_OTHERWISE, InputError, MachineError
from dlokit.extras.export import video_file
from dlokit.extras.export.export import forms
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.export_format import EXPORTS, added_formats
from dlokit.recording.reader import RawRecording, read_recording
from dlokit.system.results.run_result import write_result

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
RUN = REFERENCES / "farthest.mcap"
OTHER = REFERENCES / "wire.mcap"  # without pictures


def recorded(topic: str) -> list[Any]:
    return [one.message for one in read_recording(RUN, {topic})]


def export(out: Path, *flags: str) -> Path:
    assert execute(["export", str(RUN), "--out", str(out), *flags]) == 0
    return out


def test_npz_has_one_file_per_topic_one_row_per_message_and_exact_values(tmp_path: Path) -> None:
    folder = export(tmp_path / "out", "--to", "npz")
    states = recorded("model/state")
    with np.load(folder / "model_state.npz") as arrays:
        np.testing.assert_array_equal(arrays["nodes_world"], [one.nodes_world for one in states])
        np.testing.assert_array_equal(arrays["stamp_ns"], [one.stamp_ns for one in states])
        assert arrays["log_ns"].dtype == np.int64
    with np.load(folder / "robot_state.npz") as arrays:
        assert arrays["T_world_tcp.position_m"].shape == (len(recorded("robot/state")), 3)
        assert set(arrays["mode"]) <= {"idle", "moving"}
    with np.load(folder / "planning_action.npz") as arrays:
        assert arrays["kind"].tolist() == ["pick-and-place"]
        assert arrays["grasp.node"].tolist() == [one.grasp.node for one in recorded("planning/action")]


@pytest.fixture(autouse=True)
def no_ffmpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    """Videos are encoded in this process, also where the machine has ffmpeg."""
    monkeypatch.setattr(video_file, "ffmpeg_program", lambda: None)


@pytest.mark.parametrize("form", ["npz", "csv", "lerobot", "mp4"])
def test_a_data_set_has_no_files_of_the_program_that_wrote_it(form: str, tmp_path: Path) -> None:
    smaller = ["--width-px", "80", "--fps", "2"] if form in ("lerobot", "mp4") else []
    folder = export(tmp_path / "out", "--to", form, *smaller)
    assert any(folder.iterdir())
    assert [path for path in folder.rglob(".*") if path.is_file()] == []


def test_an_export_that_fails_leaves_no_claim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("dlokit.extras.export.export.write_npz", full)
    with pytest.raises(OSError, match="no space left"):
        export(tmp_path / "out", "--to", "npz")
    assert list((tmp_path / "out").iterdir()) == []


def test_clouds_of_different_sizes_are_concatenated_with_their_offsets(tmp_path: Path) -> None:
    folder = export(tmp_path / "out", "--to", "npz")
    clouds = recorded("perception/cloud")
    with np.load(folder / "perception_cloud.npz") as arrays:
        points, first = arrays["points_world"], arrays["points_world.first"]
    for number, cloud in enumerate(clouds):
        np.testing.assert_array_equal(points[first[number] : first[number + 1]], cloud.points_world)


def test_a_missing_field_is_nan(tmp_path: Path) -> None:
    folder = export(tmp_path / "out", "--to", "npz")
    with np.load(folder / "decision_gripped.npz") as arrays:
        held = [one.node for one in recorded("decision/gripped")]
        assert None in held
        np.testing.assert_array_equal(arrays["node"], [np.nan if node is None else node for node in held])


def test_csv_has_one_heading_per_number_and_reports_omitted_fields(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = export(tmp_path / "out", "--to", "csv")
    with (folder / "model_state.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    states = recorded("model/state")
    assert len(rows) == len(states)
    assert float(rows[-1]["nodes_world_30_2"]) == states[-1].nodes_world[30, 2]
    with (folder / "skill_calls.csv").open(newline="") as file:
        calls = list(csv.DictReader(file))
    assert {call["outcome"] for call in calls} == {"succeeded"}
    assert "perception_cloud.points_world" in " ".join(capsys.readouterr().out.split())


def test_pictures_are_the_files_that_were_recorded(tmp_path: Path) -> None:
    folder = export(tmp_path / "out", "--to", "csv")
    stamps = [record.publish_time for channel, record in RawRecording(path=RUN) if channel == "view/left"]
    files = sorted((folder / "pictures" / "left").iterdir())
    assert [int(file.stem) for file in files] == stamps
    assert all(file.read_bytes().startswith(b"\xff\xd8") for file in files)


def test_a_lerobot_dataset_is_written_and_each_episode_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    flags = ["--to", "lerobot", "--fps", "5", "--width-px", "80", "--out", str(out)]
    assert execute(["export", str(RUN), str(RUN), *flags]) == 0
    assert json.loads((out / "meta/info.json").read_text())["total_episodes"] == 2
    printed = " ".join(capsys.readouterr().out.split())
    assert "frames, success, task: bring the soft rope into the shape I" in printed
    assert "pictures: 2 recorded ones" in printed


def test_an_incomplete_recording_is_exported_and_said_in_the_last_line_and_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_a_wrong_bit(RUN, len(chunks_of(RUN)) // 2, tmp_path / FILE_NAME)
    assert execute(["export", str(path), str(RUN), "--to", "npz", "--out", str(tmp_path / "out")]) == EXIT_OTHERWISE
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(f"{path} is incomplete, and the export has the rest of it: 1 of the chunks of")


@pytest.mark.parametrize("known", [True, False])
def test_a_run_whose_recording_was_cut_has_the_success_of_its_result_or_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], known: bool
) -> None:
    path = cut_after(RUN, 0.85, tmp_path / FILE_NAME)
    if known:
        write_result(tmp_path, made_run(()))
    flags = ["--to", "lerobot", "--no-images", "--out", str(tmp_path / "out")]
    assert execute(["export", str(path), *flags]) == EXIT_OTHERWISE
    said, word = ("success, task", "| yes |") if known else ("success unknown, task", "| unknown |")
    assert f"frames, {said}" in capsys.readouterr().out
    assert word in (tmp_path / "out" / "README.md").read_text()


def test_a_file_that_is_no_recording_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "bag.mcap").write_bytes(b"#ROSBAG V2.0")
    with pytest.raises(InputError, match=r"bag\.mcap is not an MCAP file"):
        execute(["export", str(RUN), str(tmp_path / "bag.mcap"), "--to", "npz", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_only_exported_files_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export(tmp_path / "out", "--to", "csv")
    files = [file for file in (tmp_path / "out").rglob("*") if file.is_file() and not file.name.startswith(".")]
    assert f"{tmp_path / 'out'}: {len(files)} files of {RUN}" in capsys.readouterr().out


def test_a_video_is_in_the_folder_of_its_run_unless_told_otherwise(tmp_path: Path) -> None:
    run = tmp_path / "a-run"
    run.mkdir()
    shutil.copy(RUN, run / FILE_NAME)
    small = ["--to", "mp4", "--width-px", "80", "--fps", "2", "--speed", "4"]
    assert execute(["export", str(run), *small]) == 0
    assert execute(["export", str(run), "--out", str(tmp_path / "one.mp4"), *small]) == 0
    assert execute(["export", str(run), "--out", str(tmp_path / "folder"), *small]) == 0
    assert (run / "run.mp4").read_bytes() == (tmp_path / "one.mp4").read_bytes()
    assert (tmp_path / "folder" / "a-run.mp4").stat().st_size > 0
    with pytest.raises(InputError, match=r"run\.mp4 exists already; it is not overwritten"):
        execute(["export", str(run), *small])
    with pytest.raises(InputError, match="is one video, and 2 runs are given"):
        execute(["export", str(run), str(run), "--out", str(tmp_path / "two.mp4"), *small])
    with pytest.raises(InputError, match="two runs would be written to"):
        execute(["export", str(run), str(run), "--out", str(tmp_path / "both"), *small])


def test_without_pyarrow_the_error_names_the_package_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", none)
    with pytest.raises(MachineError, match=r"export --to lerobot needs dlokit's extra `export`.*\[export\]"):
        execute(["export", str(RUN), "--to", "lerobot", "--out", str(tmp_path / "out")])


@pytest.mark.parametrize(
    ("flags", "match"),
    [
        ([str(OTHER), "--to", "lerobot"], "contains no view/left, view/right, .*--no-images"),
        ([str(RUN), str(OTHER), "--to", "lerobot", "--fps", "0"], "--fps is 0; it must be 1 to 100"),
        ([str(RUN), "--to", "mp4", "--width-px", "10"], "--width-px is 10; it must be 64 to 1920"),
        ([str(RUN), "--to", "mp4", "--speed", "0"], "--speed is 0; it must be 0.1 to 100"),
        ([str(RUN.with_name("none.mcap")), "--to", "npz"], "cannot be read"),
    ],
)
def test_an_impossible_export_is_refused_with_a_remedy(tmp_path: Path, flags: list[str], match: str) -> None:
    with pytest.raises(InputError, match=match):
        execute(["export", *flags, "--out", str(tmp_path / "out")])


def test_a_folder_that_is_not_empty_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("")
    with pytest.raises(InputError, match="is not empty"):
        execute(["export", str(RUN), "--to", "npz", "--out", str(tmp_path)])


ADDED_FORMATS = """
from dlokit.recording.export_format import ExportFormat

def write(paths, out, progress):
    (out / "lengths.txt").write_text(str(len(paths)))
    return [f"{out}: lengths of {len(paths)} runs"]

def check(paths):
    if len(paths) > 2:
        raise ValueError("too many")

lengths = ExportFormat(name="lengths", doc="the lengths of runs", check=check, write=write)
taken = ExportFormat(name="npz", doc="arrays", check=check, write=write)
"""


def test_a_format_of_another_package_is_written_and_cannot_take_the_name_of_one_of_dlokit(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    entries = {"lengths": "of_formats:lengths", "taken": "of_formats:taken"}
    install(tmp_path, "formats-of", EXPORTS, entries, {"of_formats": ADDED_FORMATS})
    added_formats.cache_clear()
    try:
        flags = ["--to", "lengths", "--out", str(tmp_path / "out")]
        assert execute(["export", str(RUN), str(OTHER), *flags]) == 0
        assert (tmp_path / "out" / "lengths.txt").read_text() == "2"
        assert "lengths of 2 runs" in capsys.readouterr().out
        assert "is called 'npz', as another" in caplog.text
        assert "lengths: the lengths of runs." in forms()
        with pytest.raises(ValueError, match="too many"):
            execute(["export", str(RUN), str(RUN), str(RUN), "--to", "lengths", "--out", str(tmp_path / "more")])
        assert not (tmp_path / "more").exists()
    finally:
        added_formats.cache_clear()


@pytest.mark.parametrize("form", ["npz", "csv", "lerobot"])
def test_a_data_set_needs_a_folder(form: str) -> None:
    with pytest.raises(InputError, match=f"--to {form} needs a folder: give --out"):
        execute(["export", str(RUN), "--to", form])
