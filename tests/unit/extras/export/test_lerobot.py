"""The layout of a LeRobot data set of version 3.0; LeRobot itself reads one in `tests/peers`."""

import json
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as parquet
import pytest
from videos import apart, read_video

from dlokit.errors import InputError
from dlokit.extras.export import lerobot
from dlokit.extras.export.frames import read_frames
from dlokit.extras.export.lerobot import DatasetOptions, EpisodeSummary, write_lerobot
from dlokit.extras.export.pictures import Shot, resized
from dlokit.extras.export.recorded_scene import RecordedScene
from dlokit.recording.channels import FILE_NAME
from dlokit.types.image import StereoImages

pytestmark = pytest.mark.xdist_group("simulated_run")

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
RUN, OTHER = REFERENCES / "farthest.mcap", REFERENCES / "rollout.mcap"
SMALL = DatasetOptions(fps=5, width_px=80)
NUMBERS = DatasetOptions(fps=5, images=False)
LEFT, RIGHT = "observation.images.left", "observation.images.right"


def write(folder: Path, *paths: Path, options: DatasetOptions = SMALL) -> list[EpisodeSummary]:
    folder.mkdir()
    return write_lerobot(paths, folder, options, lambda *_: None)


@dataclass(frozen=True)
class Written:
    """A data set of one run twice, that no test changes."""

    out: Path
    summaries: list[EpisodeSummary]


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> Written:
    out = tmp_path_factory.mktemp("lerobot") / "set"
    return Written(out, write(out, RUN, RUN))


def info_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "meta/info.json").read_text())


def episodes_of(folder: Path) -> list[dict[str, Any]]:
    return parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def test_a_dataset_has_the_files_of_version_3_and_describes_each_feature(twice: Written) -> None:
    out, written = twice.out, twice.summaries
    info, episodes = info_of(out), episodes_of(out)
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 5, "panda")
    assert (info["total_episodes"], info["total_tasks"], info["splits"]) == (2, 1, {"train": "0:2"})
    assert info["total_frames"] == sum(one.frames for one in written) == sum(one["length"] for one in episodes)
    table = parquet.read_table(out / info["data_path"].format(chunk_index=0, file_index=0))
    features = info["features"]
    videos = {name for name, feature in features.items() if feature["dtype"] == "video"}
    assert videos == {LEFT, RIGHT}
    assert set(table.column_names) == set(features) - videos
    described = json.loads(table.schema.metadata[b"huggingface"])["info"]["features"]
    assert set(described) == set(table.column_names)
    for name in table.column_names:
        first, feature = table[name][0].as_py(), features[name]
        if feature["shape"] != [1]:
            assert len(first) == feature["shape"][0] == len(feature["names"])
    for name in videos:
        assert features[name]["shape"] == [70, 80, 3]
        assert features[name]["info"]["video.codec"] == "vp9"
        assert (
            len(read_video(out / info["video_path"].format(video_key=name, chunk_index=0, file_index=0)))
            == (info["total_frames"])
        )
    assert "| 1 | references |" in (out / "README.md").read_text()


def test_episodes_follow_one_another_in_the_same_files(twice: Written) -> None:
    out = twice.out
    episodes = episodes_of(out)
    table = parquet.read_table(out / "data/chunk-000/file-000.parquet")
    assert table["index"].to_pylist() == list(range(len(table)))
    begin = 0
    for number, one in enumerate(episodes):
        assert (one["episode_index"], one["dataset_from_index"]) == (number, begin)
        begin += one["length"]
        assert one["dataset_to_index"] == begin
        rows = table.slice(one["dataset_from_index"], one["length"])
        assert rows["episode_index"].to_pylist() == [number] * one["length"]
        np.testing.assert_allclose(rows["timestamp"].to_numpy(), np.arange(one["length"]) / 5, atol=1e-6)
        assert one[f"videos/{LEFT}/from_timestamp"] == pytest.approx(one["dataset_from_index"] / 5)
        assert one[f"videos/{LEFT}/to_timestamp"] == pytest.approx(one["dataset_to_index"] / 5)
        places = [f"{kind}/{of}" for kind in ("data", f"videos/{LEFT}") for of in ("chunk_index", "file_index")]
        assert [one[place] for place in places] == [0, 0, 0, 0]


@pytest.mark.heavy
def test_each_picture_of_a_simulated_run_is_that_of_its_frame(simulated_run: Path, tmp_path: Path) -> None:
    path, out = simulated_run / FILE_NAME, tmp_path / "set"
    (written,) = write(out, path, options=DatasetOptions(fps=2, width_px=160))
    assert written.pictures == "rendered again, one for each frame"
    shown = read_video(out / f"videos/{LEFT}/chunk-000/file-000.mp4")
    times_ns = read_frames(path, 2).times_ns
    assert len(shown) == len(times_ns) == written.frames
    ages_s = parquet.read_table(out / "data/chunk-000/file-000.parquet")["picture_age"].to_numpy()
    assert not ages_s.any()
    moving = 0
    with closing(RecordedScene(path)) as scene:
        for time_ns, picture in list(zip(times_ns.tolist(), shown, strict=True))[2:-2:2]:
            offs: dict[int, float] = {}
            for off_ms in (-100, -50, 0, 50, 100):
                pictures = scene.pictures(time_ns + off_ms * 1_000_000)
                assert isinstance(pictures, StereoImages)
                small = resized(Shot(views={"left": pictures.left}), 160).views["left"]
                offs[off_ms] = apart(small, picture)
            if min(offs[-100], offs[100]) > offs[0] + 0.5:  # of 255; the codec's own errors are below
                moving += 1
                assert min(offs, key=lambda off_ms: offs[off_ms]) == 0
    assert moving >= 5


def test_recorded_pictures_are_repeated_and_their_ages_and_rate_told(twice: Written) -> None:
    written = twice.summaries[0]
    assert written.pictures.startswith("2 recorded ones, ")
    ages_s = parquet.read_table(twice.out / "data/chunk-000/file-000.parquet")["picture_age"].to_numpy()
    ages_s = ages_s[: written.frames]
    assert np.sum(np.diff(ages_s) < 0.0) == 1  # the second picture
    assert ages_s.max() > 1.0
    assert "recorded ones" in (twice.out / "README.md").read_text()


def test_statistics_are_those_of_all_frames(tmp_path: Path) -> None:
    out = tmp_path / "set"
    write(out, RUN, OTHER, options=NUMBERS)
    stats = json.loads((out / "meta/stats.json").read_text())
    table = parquet.read_table(out / "data/chunk-000/file-000.parquet")
    assert set(stats) == set(table.column_names)
    state = np.array(table["observation.state"].to_pylist())
    for name, value in (("min", state.min(0)), ("max", state.max(0)), ("mean", state.mean(0)), ("std", state.std(0))):
        np.testing.assert_allclose(stats["observation.state"][name], value, rtol=1e-4, atol=1e-6)
    assert stats["observation.state"]["count"] == [len(table)]
    of_episode = episodes_of(out)[1]
    assert of_episode["stats/next.done/max"] == [1.0]
    assert np.shape(of_episode["stats/observation.state/q90"]) == (state.shape[1],)


def test_statistics_of_pictures_are_per_channel_from_0_to_1(twice: Written) -> None:
    stats = json.loads((twice.out / "meta/stats.json").read_text())[LEFT]
    for name in ("min", "max", "mean", "std", "q01", "q99"):
        assert np.shape(stats[name]) == (3, 1, 1)
    assert 0.0 <= stats["min"][0][0][0] < stats["mean"][0][0][0] < stats["max"][0][0][0] <= 1.0


def test_tasks_are_the_index_of_their_table(tmp_path: Path) -> None:
    write(tmp_path / "set", RUN, OTHER, RUN, options=NUMBERS)
    table = parquet.read_table(tmp_path / "set/meta/tasks.parquet")
    assert table["task"].to_pylist() == ["bring the soft rope into the shape I", "bring the soft rope into the shape S"]
    assert table["task_index"].to_pylist() == [0, 1]
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    data = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    assert [one["tasks"] for one in episodes_of(tmp_path / "set")][1] == ["bring the soft rope into the shape S"]
    assert sorted(set(data["task_index"].to_pylist())) == [0, 1]


def test_depths_are_png_files_of_16_bits_in_millimetres(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    depth_m = np.linspace(0.0, 3.0, 12, dtype=np.float32).reshape(4, 3).repeat(20, axis=0).repeat(20, axis=1)

    class OneShot:
        origin, first_ns = "made", 0

        def at(self, time_ns: int) -> Shot:
            return Shot(views={"colour": np.full((80, 60, 3), 90, dtype=np.uint8)}, depth_m=depth_m)

    @contextmanager
    def pictures(_: Path) -> Generator[OneShot]:
        yield OneShot()

    monkeypatch.setattr(lerobot, "pictures_of", pictures)
    write(tmp_path / "set", RUN, options=DatasetOptions(fps=5))
    feature = info_of(tmp_path / "set")["features"]["observation.images.depth"]
    assert (feature["dtype"], feature["shape"]) == ("image", [80, 60, 1])
    assert feature["info"] == {"is_depth_map": True, "depth_unit": "mm"}
    first = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")["observation.images.depth"][0].as_py()
    assert first["path"] == "frame_000000.png"
    read = cv2.imdecode(np.frombuffer(first["bytes"], dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    assert read is not None
    assert read.dtype == np.uint16
    np.testing.assert_array_equal(read, np.round(depth_m * 1e3))
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())["observation.images.depth"]
    assert stats["max"] == [[[3000.0]]]


def test_a_file_that_is_large_enough_is_followed_by_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lerobot, "DATA_FILE_MB", 0)
    monkeypatch.setattr(lerobot, "VIDEO_FILE_MB", 0)
    out = tmp_path / "set"
    write(out, RUN, RUN, options=DatasetOptions(fps=1, width_px=80))
    episodes = episodes_of(out)
    assert [one["data/file_index"] for one in episodes] == [0, 1]
    assert [one[f"videos/{LEFT}/file_index"] for one in episodes] == [0, 1]
    assert [one[f"videos/{LEFT}/from_timestamp"] for one in episodes] == [0.0, 0.0]
    second = parquet.read_table(out / "data/chunk-000/file-001.parquet")
    assert set(second["episode_index"].to_pylist()) == {1}
    assert len(read_video(out / f"videos/{LEFT}/chunk-000/file-001.mp4")) == len(second)


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_an_interrupted_export_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    def fail(path: Path, done: int, total: int) -> None:
        if done == 3:
            raise error

    with pytest.raises(error):
        write_lerobot([RUN], tmp_path, SMALL, fail)
    assert list(tmp_path.iterdir()) == []


def test_runs_with_other_features_are_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = lerobot.read_frames

    def fewer(path: Path, fps: int, *, first_ns: int = 0) -> Any:
        frames = whole(path, fps, first_ns=first_ns)
        if path == OTHER:
            frames.features.pop("observation.targets")
        return frames

    monkeypatch.setattr(lerobot, "read_frames", fewer)
    with pytest.raises(InputError, match=r"rollout\.mcap differs from .*farthest\.mcap in observation\.targets"):
        write(tmp_path / "set", RUN, OTHER, options=NUMBERS)
