"""`dlokit export`: the exported data equal the recorded data."""

import csv
import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dlokit.app.commands import execute
from dlokit.app.data.lerobot import read_frames
from dlokit.errors import InputError, MachineError
from dlokit.recording.reader import RawRecording, read_recording

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


def test_frames_have_the_state_and_the_next_tool_pose_as_action() -> None:
    frames = read_frames(RUN, 20, images=True)
    state, action = frames.features["observation.state"], frames.features["action"]
    assert frames.robots == ("panda",)
    tool = [state.names.index(name) for name in action.names]
    np.testing.assert_array_equal(action.values[:-1], state.values[1:][:, tool])
    goal = recorded("model/goal")[0].nodes_world.astype(np.float32)
    np.testing.assert_array_equal(
        frames.features["observation.goal"].values, np.tile(goal.ravel(), (len(state.values), 1))
    )
    shapes = [one.nodes_world.astype(np.float32).ravel().tolist() for one in recorded("model/state")]
    told = [shapes.index(row.tolist()) for row in frames.features["observation.environment_state"].values]
    assert told == sorted(told)
    assert len(set(told)) >= len(shapes) - 4  # but for those that another followed at once
    assert len(frames.images["observation.images.left"]) == len(state.values)


def test_a_lerobot_dataset_has_one_episode_per_run_and_describes_each_feature(tmp_path: Path) -> None:
    parquet = importlib.import_module("pyarrow.parquet")
    out = tmp_path / "out"
    assert execute(["export", str(RUN), str(RUN), "--to", "lerobot", "--fps", "5", "--out", str(out)]) == 0
    info = json.loads((out / "meta/info.json").read_text())
    episodes = [json.loads(line) for line in (out / "meta/episodes.jsonl").read_text().splitlines()]
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v2.1", 5, 2)
    assert info["robot_type"] == "panda"
    assert info["total_frames"] == sum(one["length"] for one in episodes)
    index = 0
    for episode in episodes:
        number = episode["episode_index"]
        table = parquet.read_table(out / info["data_path"].format(episode_chunk=0, episode_index=number))
        assert set(table.column_names) == set(info["features"])
        assert table["index"].to_pylist() == list(range(index, index + episode["length"]))
        index += episode["length"]
        for name, feature in info["features"].items():
            first = table[name][0].as_py()
            if feature["dtype"] == "image":
                assert first["bytes"].startswith(b"\xff\xd8")
                assert feature["shape"] == [560, 640, 3]
            elif feature["shape"] != [1]:
                assert len(first) == feature["shape"][0] == len(feature["names"])
        features = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
        assert set(features) == set(info["features"])
    stats = [json.loads(line)["stats"] for line in (out / "meta/episodes_stats.jsonl").read_text().splitlines()]
    assert set(stats[0]) == set(info["features"])
    assert 0.0 < stats[0]["observation.images.left"]["mean"][0][0][0] < 1.0
    assert json.loads((out / "meta/tasks.jsonl").read_text())["task"] == "shape the DLO: random to I"


def test_without_pyarrow_the_error_names_the_package_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", none)
    with pytest.raises(MachineError, match=r"pip install 'dlokit\[export\]'"):
        execute(["export", str(RUN), "--to", "lerobot", "--out", str(tmp_path / "out")])


@pytest.mark.parametrize(
    ("flags", "match"),
    [
        ([str(OTHER), "--to", "lerobot"], "contains no view/left, view/right; .*--no-images"),
        ([str(RUN), str(OTHER), "--to", "lerobot", "--fps", "0"], "--fps is 0; it must be 1 to 100"),
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
