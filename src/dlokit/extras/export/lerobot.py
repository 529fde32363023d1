"""Recorded runs as a LeRobot data set, version 3.0: one episode per run, frames at a constant rate, pictures as videos.

meta/info.json  meta/stats.json  meta/tasks.parquet  meta/episodes/chunk-000/file-000.parquet  README.md
data/chunk-000/file-000.parquet            the numbers of all episodes, one after the other; depth pictures inside
videos/<view>/chunk-000/file-000.mp4       the pictures of all episodes, one after the other
When a file reaches its size limit, file-001 follows; an episode is never split across two files.
"""

import importlib
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlokit.errors import InputError, lacks_extra
from dlokit.extras.export.dataset_stats import DEPTH_VIEW, PictureSamples, Stats, stats_of_all, stats_of_rows
from dlokit.extras.export.frames import SUCCESS, Feature, Frames, read_frames
from dlokit.extras.export.pictures import RunPictures, Shot, pictures_of, resized
from dlokit.extras.export.video_file import CODEC, VideoFile
from dlokit.recording.views import to_png

VERSION = "v3.0"
IMAGES = "observation.images."
"""Beginning of the names of pictures."""
DEPTH = IMAGES + DEPTH_VIEW
AGE = "picture_age"
FILES_PER_FOLDER = 1000
DATA_FILE_MB, VIDEO_FILE_MB = 100, 200
"""Sizes at which the writer starts the next file, LeRobot's usual limits [2^20 bytes]."""
FIRST_FILE = "chunk-000/file-000"
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_COUNTERS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """Settings of the conversion of runs to a data set."""

    fps: int
    images: bool = True
    """Whether frames have pictures."""
    width_px: int | None = None
    """Width of the pictures [px]; None: as the camera takes them."""


@dataclass(frozen=True, kw_only=True)
class EpisodeSummary:
    """Summary of one written run."""

    path: Path
    frames: int
    task: str
    success: bool | None
    """Outcome of the run; None if neither the recording nor a result.json beside it contains it."""
    pictures: str
    """Source of its pictures."""


Progress = Callable[[Path, int, int], None]
"""Called with the run, the number of its written frames, and the number of all its frames."""


def write_lerobot(
    paths: Sequence[Path], folder: Path, options: DatasetOptions, progress: Progress
) -> list[EpisodeSummary]:
    """Write the data set into an empty folder; after an exception the folder is empty again.

    Raises `MachineError` when pyarrow is not installed, and `InputError` when the runs do not fit into one data set.
    """
    arrow = _pyarrow()
    try:
        with closing(_Dataset(arrow, folder, options)) as dataset:
            for path in paths:
                dataset.add(path, progress)
            return dataset.write_meta()
    except BaseException:
        for entry in ("meta", "data", "videos"):
            shutil.rmtree(folder / entry, ignore_errors=True)
        (folder / README).unlink(missing_ok=True)
        raise


def _pyarrow() -> Any:
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError as error:
        raise lacks_extra("dlokit export --to lerobot", "export") from error


@dataclass
class _Place:
    """Number of a file of a kind, and the amount of data in it."""

    number: int = 0
    first_s: float = 0.0
    """Time in the video at which the present episode begins [s]."""

    @property
    def fields(self) -> dict[str, int]:
        """Its folder and number."""
        return {"chunk_index": self.number // FILES_PER_FOLDER, "file_index": self.number % FILES_PER_FOLDER}

    @property
    def name(self) -> str:
        """Path below the folder of its kind, without the ending."""
        return FILE.format(**self.fields)


@dataclass
class _Video:
    """The videos of one view."""

    folder: Path
    shape: tuple[int, ...]
    place: _Place = field(default_factory=_Place)
    file: VideoFile | None = None


class _Dataset:
    """A data set that grows by one episode at a time; memory holds one episode."""

    def __init__(self, arrow: Any, folder: Path, options: DatasetOptions) -> None:
        self._arrow, self._folder, self._options = arrow, folder, options
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._stats: list[Stats] = []
        self._summaries: list[EpisodeSummary] = []
        self._first: tuple[Path, Frames, dict[str, Any]] | None = None
        self._videos: dict[str, _Video] = {}
        self._data = _Place()
        self._parquet: Any = None
        self._total = 0

    def add(self, path: Path, progress: Progress) -> None:
        """Append a run. Raises `InputError` if it is not a run, or does not match the first."""
        if not self._options.images:
            self._append(path, read_frames(path, self._options.fps), None, progress)
            return
        with pictures_of(path) as pictures:
            frames = read_frames(path, self._options.fps, first_ns=pictures.first_ns)
            self._append(path, frames, pictures, progress)

    def write_meta(self) -> list[EpisodeSummary]:
        """Complete the files and describe them; `info.json` comes last, because it makes the folder a data set."""
        self.close()
        assert self._first is not None, "the command line requires at least one file"
        parquet, meta = self._arrow.parquet, self._folder / "meta"
        (meta / "episodes" / FIRST_FILE).parent.mkdir(parents=True)
        parquet.write_table(self._arrow.Table.from_pylist(self._episodes), meta / f"episodes/{FIRST_FILE}.parquet")
        parquet.write_table(_tasks_table(self._arrow, self._tasks), meta / "tasks.parquet")
        stats = {name: _plain(of) for name, of in stats_of_all(self._stats).items()}
        (meta / "stats.json").write_text(json.dumps(stats, indent=4) + "\n", encoding="utf-8")
        (self._folder / README).write_text(_readme(self._summaries, self._options.fps), encoding="utf-8")
        (meta / "info.json").write_text(json.dumps(self._info(), indent=4) + "\n", encoding="utf-8")
        return self._summaries

    def _append(self, path: Path, frames: Frames, pictures: RunPictures | None, progress: Progress) -> None:
        length, fps = len(frames.times_ns), self._options.fps
        shot = None if pictures is None else self._shot(pictures, int(frames.times_ns[0]))
        described = _features(frames, shot, fps)
        self._require_alike(path, frames, described)
        task = self._tasks.setdefault(frames.task, len(self._tasks))
        counters = _counters(length, fps, len(self._episodes), self._total, task)
        numbers, depths, of_pictures, origin = dict(frames.features), list[bytes](), Stats(), "none"
        if pictures is not None:
            self._begin_videos(described)
            ages_s, depths, of_pictures = self._add_pictures(path, frames, pictures, progress)
            numbers[AGE] = Feature(names=None, values=ages_s)
            origin = pictures.origin
        self._write_rows(numbers, counters, depths)
        columns = {name: of.values for name, of in numbers.items()} | {n: of[:, None] for n, of in counters.items()}
        stats = {name: stats_of_rows(of.astype(np.float64)) for name, of in columns.items()}
        self._note_episode(frames.task, length, stats | of_pictures)
        success = None if frames.outcome is None else bool(frames.features[SUCCESS].values.any())
        self._summaries.append(
            EpisodeSummary(path=path, frames=length, task=frames.task, success=success, pictures=origin)
        )
        self._total += length

    def _shot(self, pictures: RunPictures, time_ns: int) -> Shot:
        return resized(pictures.at(time_ns), self._options.width_px)

    def _add_pictures(
        self, path: Path, frames: Frames, pictures: RunPictures, progress: Progress
    ) -> tuple[NDArray[Any], list[bytes], Stats]:
        """Append the pictures of a run to the videos; returns their ages (T, 1) [s], depths, and statistics."""
        length = len(frames.times_ns)
        samples, depths = PictureSamples(length), list[bytes]()
        ages_s = np.zeros((length, 1), dtype=np.float32)
        for number, time_ns in enumerate(frames.times_ns.tolist()):
            shot = self._shot(pictures, time_ns)
            ages_s[number] = shot.age_s
            for name, view in shot.views.items():
                file = self._videos[IMAGES + name].file
                assert file is not None, "it was opened when the episode began"
                file.add(view)
            if shot.depth_m is not None:
                depths.append(to_png(shot.depth_m))
            samples.add(number, shot)
            progress(path, number + 1, length)
        return ages_s, depths, {IMAGES + name: of for name, of in samples.stats().items()}

    def _require_alike(self, path: Path, frames: Frames, described: dict[str, Any]) -> None:
        if self._first is None:
            self._first = (path, frames, described)
            return
        first_path, first, of_first = self._first
        if described != of_first or frames.robots != first.robots:
            differing = [name for name in (described | of_first) if described.get(name) != of_first.get(name)]
            raise InputError(
                f"{path} differs from {first_path} in {', '.join(differing) or 'the arms'}: runs of one data set have "
                "the same arms, cameras and number of nodes; export them separately."
            )

    def _begin_videos(self, described: Mapping[str, Any]) -> None:
        """Open the videos, or continue with the next files if the present ones are large enough."""
        for name, feature in described.items():
            if feature["dtype"] != "video":
                continue
            video = self._videos.setdefault(
                name, _Video(folder=self._folder / "videos" / name, shape=tuple(feature["shape"]))
            )
            if video.file is not None and video.file.size_bytes >= VIDEO_FILE_MB << 20:
                video.file.close()
                video.file, video.place = None, _Place(number=video.place.number + 1)
            if video.file is None:
                path = video.folder / f"{video.place.name}.mp4"
                path.parent.mkdir(parents=True, exist_ok=True)
                height_px, width_px, _ = video.shape
                video.file = VideoFile(path, self._options.fps, width_px, height_px)
            video.place.first_s = video.file.frames / self._options.fps

    def _write_rows(
        self, numbers: Mapping[str, Feature], counters: Mapping[str, NDArray[Any]], depths: list[bytes]
    ) -> None:
        table = _table(self._arrow, numbers, counters, depths)
        path = self._folder / "data" / f"{self._data.name}.parquet"
        if self._parquet is not None and path.stat().st_size >= DATA_FILE_MB << 20:
            self._parquet.close()
            self._parquet, self._data = None, _Place(number=self._data.number + 1)
            path = self._folder / "data" / f"{self._data.name}.parquet"
        if self._parquet is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._parquet = self._arrow.parquet.ParquetWriter(path, table.schema, compression="zstd")
        self._parquet.write_table(table)

    def _note_episode(self, task: str, length: int, stats: Stats) -> None:
        row: dict[str, Any] = {"episode_index": len(self._episodes), "tasks": [task], "length": length}
        row |= {f"data/{name}": value for name, value in self._data.fields.items()}
        row |= {"dataset_from_index": self._total, "dataset_to_index": self._total + length}
        for name, video in self._videos.items():
            row |= {f"videos/{name}/{key}": value for key, value in video.place.fields.items()}
            row[f"videos/{name}/from_timestamp"] = video.place.first_s
            row[f"videos/{name}/to_timestamp"] = video.place.first_s + length / self._options.fps
        row |= {f"meta/episodes/{name}": value for name, value in _Place().fields.items()}
        row |= {f"stats/{name}/{key}": value for name, of in stats.items() for key, value in _plain(of).items()}
        self._episodes.append(row)
        self._stats.append(stats)

    def _info(self) -> dict[str, Any]:
        assert self._first is not None, "write_meta has checked it"
        _, frames, described = self._first
        return {
            "codebase_version": VERSION,
            "robot_type": "_".join(frames.robots),
            "total_episodes": len(self._episodes),
            "total_frames": self._total,
            "total_tasks": len(self._tasks),
            "chunks_size": FILES_PER_FOLDER,
            "data_files_size_in_mb": DATA_FILE_MB,
            "video_files_size_in_mb": VIDEO_FILE_MB,
            "fps": self._options.fps,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": f"data/{FILE}.parquet",
            "video_path": f"videos/{{video_key}}/{FILE}.mp4" if self._videos else None,
            "features": described,
        }

    def close(self) -> None:
        """Close the files."""
        if self._parquet is not None:
            self._parquet.close()
            self._parquet = None
        for video in self._videos.values():
            if video.file is not None:
                video.file.close()
                video.file = None


def _counters(length: int, fps: int, episode: int, before: int, task: int) -> dict[str, NDArray[Any]]:
    number = np.arange(length)
    values = (number / fps, number, np.full(length, episode), before + number, np.full(length, task))
    return {name: of.astype(kind) for (name, kind), of in zip(_COUNTERS.items(), values, strict=True)}


def _features(frames: Frames, shot: Shot | None, fps: int) -> dict[str, Any]:
    """The description of each feature for `info.json`."""
    described: dict[str, Any] = {
        name: {"dtype": str(of.values.dtype), "shape": [of.values.shape[1]], "names": of.names}
        for name, of in frames.features.items()
    }
    if shot is not None:
        described[AGE] = {"dtype": "float32", "shape": [1], "names": None}
        for name, view in shot.views.items():
            described[IMAGES + name] = _video_feature(view.shape, fps)
        if shot.depth_m is not None:
            axes = ["height", "width", "channels"]
            shape, about = [*shot.depth_m.shape, 1], {"is_depth_map": True, "depth_unit": "mm"}
            described[DEPTH] = {"dtype": "image", "shape": shape, "names": axes, "info": about}
    return described | {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in _COUNTERS.items()}


def _video_feature(shape: tuple[int, ...], fps: int) -> dict[str, Any]:
    height_px, width_px, channels = shape
    return {
        "dtype": "video",
        "shape": list(shape),
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": height_px,
            "video.width": width_px,
            "video.codec": CODEC,
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": fps,
            "video.channels": channels,
            "has_audio": False,
        },
    }


def _table(
    arrow: Any, numbers: Mapping[str, Feature], counters: Mapping[str, NDArray[Any]], depths: list[bytes]
) -> Any:
    arrays: dict[str, Any] = {}
    kinds: dict[str, Any] = {}
    for name, feature in numbers.items():
        flat = arrow.array(feature.values.ravel())
        value = {"dtype": str(feature.values.dtype), "_type": "Value"}
        if feature.values.shape[1] == 1:
            arrays[name], kinds[name] = flat, value
        else:
            arrays[name] = arrow.FixedSizeListArray.from_arrays(flat, feature.values.shape[1])
            kinds[name] = {"feature": value, "length": feature.values.shape[1], "_type": "List"}
    if depths:
        picture = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
        entries = [{"bytes": data, "path": f"frame_{number:06d}.png"} for number, data in enumerate(depths)]
        arrays[DEPTH], kinds[DEPTH] = arrow.array(entries, type=picture), {"_type": "Image"}
    arrays |= {name: arrow.array(of) for name, of in counters.items()}
    kinds |= {name: {"dtype": kind, "_type": "Value"} for name, kind in _COUNTERS.items()}
    # Without it, readers would treat a picture as a pair of bytes and text.
    return arrow.table(arrays).replace_schema_metadata({"huggingface": json.dumps({"info": {"features": kinds}})})


def _tasks_table(arrow: Any, tasks: Mapping[str, int]) -> Any:
    """The numbers of the tasks; the texts are the index, as readers with pandas expect."""
    table = arrow.table({"task_index": arrow.array(tasks.values(), type=arrow.int64()), "task": list(tasks)})
    columns = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"},
    ]
    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column | {"metadata": None} for column in columns],
        "pandas_version": "2.2.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _plain(stats: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    return {name: value.tolist() for name, value in stats.items()}


README = "README.md"
_SUCCESS_IN_WORDS = {True: "yes", False: "no", None: "unknown"}


def _readme(episodes: Sequence[EpisodeSummary], fps: int) -> str:
    """Text for people who receive the data set."""
    rows = "\n".join(
        f"| {number} | {one.path.parent.name} | {one.frames} | {one.task} | {_SUCCESS_IN_WORDS[one.success]} "
        f"| {one.pictures} |"
        for number, one in enumerate(episodes)
    )
    return f"""# Runs of dlokit as a LeRobot data set ({VERSION}), {fps} frames per second

Lengths are in metres, angles in radians, quaternions (w, x, y, z); poses are in the world frame. `next.reward` is minus
the root mean square distance of the estimated nodes to the goal one frame later. `next.success` is the system's own
judgement, and False where it is unknown. `{AGE}` is the time since the exposure of a frame's pictures [s]. Depths are
millimetres, 0 where unknown.

| episode | run | frames | task | success | pictures |
|---|---|---|---|---|---|
{rows}
"""
