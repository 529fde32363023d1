"""Recorded runs as a LeRobot data set, version 2.1: one episode per run, frames at a constant rate.

meta/info.json  meta/tasks.jsonl  meta/episodes.jsonl  meta/episodes_stats.jsonl
data/chunk-000/episode_000000.parquet …        with the pictures inside
"""

import importlib
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.communication import topics
from dlokit.errors import InputError, MachineError
from dlokit.recording.channels import topic_of
from dlokit.recording.reader import RawRecording, picture_file, read_recording
from dlokit.recording.views import from_jpeg
from dlokit.system.replay import recorded_config
from dlokit.types.arrays import Float32Array, Float64Array, Int64Array
from dlokit.types.robot import RobotState

STATE, ACTION = "observation.state", "action"
SHAPES = {
    topics.STATE.name: "observation.environment_state",
    topics.TARGETS.name: "observation.targets",
    topics.GOAL.name: "observation.goal",
}
"""Feature name by topic; the coordinates of all nodes (M, 3) are concatenated."""
IMAGES = {"view/left": "observation.images.left", "view/right": "observation.images.right"}
"""Feature name by view, of a stereo camera."""
COLOUR = {"view/colour": "observation.images.colour"}
"""Of a depth camera. Its depths are omitted: images of this version have 8 bits, 25 cm of depth in millimetres."""
_TOOL = ("x", "y", "z", "qw", "qx", "qy", "qz", "finger_width")


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One quantity over all frames."""

    names: list[str]
    """Names of its components."""
    values: Float32Array  # (T, n) lengths [m], angles [rad]


@dataclass(frozen=True, kw_only=True)
class Frames:
    """The frames of one run."""

    task: str
    """Description of the task in words."""
    robots: tuple[str, ...]
    """The arms' models: panda, fr3, ur5e or the name of a file; their names where the recording lacks its settings."""
    features: dict[str, Feature]
    images: dict[str, list[bytes]]
    """T files by feature: for each frame the latest picture taken until then."""


@dataclass
class _Series:
    """The published values of one quantity, with their times."""

    log_ns: list[int] = field(default_factory=list[int])
    values: list[Any] = field(default_factory=list[Any])

    def at(self, times_ns: Int64Array) -> list[Any]:
        """The latest value published until each time."""
        places = np.searchsorted(self.log_ns, times_ns, side="right") - 1
        return [self.values[place] for place in places]


def read_frames(path: Path, fps: int, *, images: bool) -> Frames:
    """Sample a recording at `fps` frames per second of its clock, from when all quantities are known to its end.

    Each value is the latest published until then. The action of a frame is the poses of the tools and the widths of
    their fingers one frame later. Raises `InputError` when robot, shape, goal or pictures are not in the recording.
    """
    recorded = _recorded(path)
    raw = RawRecording(path=path)
    pictures = _pictures(raw)  # always read: reading also fills the metadata
    robots = sorted(channel for channel in recorded if channel.startswith(topics.ROBOT_STATE.name))
    views = COLOUR if any(name in COLOUR for name in pictures) else IMAGES
    needed = (topics.ROBOT_STATE.name, *SHAPES, *(views if images else ()))
    if missing := [name for name in needed if name not in recorded and name not in pictures]:
        raise InputError(
            f"{path} contains no {', '.join(missing)}; give the recording of a run that observed the DLO"
            + (", or omit the pictures with --no-images." if images else ".")
        )
    series = recorded | (pictures if images else {})
    times_ns = _times_ns(path, fps, series.values())
    states = [cast(list[RobotState], recorded[robot].at(times_ns)) for robot in robots]
    return Frames(
        task=f"shape the DLO: {raw.metadata.get('run', {}).get('name', 'to the goal')}",
        robots=_models(path, len(states)) or tuple(one[0].robot for one in states),
        features=_robot_features(states)
        | {feature: _nodes(recorded[name], times_ns) for name, feature in SHAPES.items()},
        images={views[name]: of.at(times_ns) for name, of in pictures.items() if images},
    )


def _models(path: Path, robots: int) -> tuple[str, ...]:
    """The models of a run's arms by its settings; none where the recording has no settings that can be read."""
    try:
        config = recorded_config(path, ())
    except InputError:
        return ()
    models = [config.arm or mounted.model for mounted in config.installation.arms[:robots]]
    return tuple(Path(model).stem for model in models) if len(models) == robots else ()


class _Wanted:
    """The topics that frames are made of, of every component instance."""

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in (topics.ROBOT_STATE.name, *SHAPES)


def _recorded(path: Path) -> dict[str, _Series]:
    found: defaultdict[str, _Series] = defaultdict(_Series)
    for one in read_recording(path, _Wanted()):
        found[one.topic].log_ns.append(one.log_ns)
        found[one.topic].values.append(one.message)
    return dict(found)


def _pictures(raw: RawRecording) -> dict[str, _Series]:
    found: defaultdict[str, _Series] = defaultdict(_Series)
    for channel, record in raw:
        if channel in IMAGES or channel in COLOUR:
            found[channel].log_ns.append(record.log_time)
            found[channel].values.append(picture_file(record.data).data)
    return dict(found)


def _times_ns(path: Path, fps: int, series: Iterable[_Series]) -> Int64Array:
    spans = [(one.log_ns[0], one.log_ns[-1]) for one in series]
    first, last = max(begin for begin, _ in spans), max(end for _, end in spans)
    count = (last - first) * fps // 1_000_000_000 + 1
    if count < 2:
        raise InputError(
            f"{path} is shorter than two frames at {fps} per second; give a longer run, or a higher --fps."
        )
    return first + np.arange(count) * 1_000_000_000 // fps


def _robot_features(states: list[list[RobotState]]) -> dict[str, Feature]:
    """Features of the states (T,) of each robot: joints and tool now, and the tool one frame later."""
    tools = [np.array([_tool(state) for state in one]) for one in states]
    joints = [np.array([state.q_rad for state in one]) for one in states]
    now = [part for both in zip(joints, tools, strict=True) for part in both]
    later = [np.vstack([tool[1:], tool[-1:]]) for tool in tools]
    tool_names = [[f"{one[0].robot}_{name}" for name in _TOOL] for one in states]
    joint_names = [[f"{one[0].robot}_joint{number + 1}" for number in range(len(one[0].q_rad))] for one in states]
    now_names = [name for both in zip(joint_names, tool_names, strict=True) for part in both for name in part]
    return {
        STATE: Feature(names=now_names, values=np.hstack(now).astype(np.float32)),
        ACTION: Feature(names=[name for of in tool_names for name in of], values=np.hstack(later).astype(np.float32)),
    }


def _tool(state: RobotState) -> Float64Array:
    return np.concatenate([state.T_world_tcp.position_m, state.T_world_tcp.wxyz, [state.finger_width_m]])


def _nodes(series: _Series, times_ns: Int64Array) -> Feature:
    nodes = np.array([message.nodes_world for message in series.at(times_ns)], dtype=np.float32)
    names = [f"node{node}_{axis}" for node in range(nodes.shape[1]) for axis in "xyz"]
    return Feature(names=names, values=nodes.reshape(len(nodes), -1))


VERSION = "v2.1"
CHUNK = 1000
"""Number of episodes per folder."""
PICTURES_OF_STATS = 20
"""Maximum number of pictures per episode that its statistics are computed from."""
PIXELS_OF_STATS = 4
"""The statistics use every n-th pixel along each side."""
_COUNTERS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def write_lerobot(paths: Sequence[Path], folder: Path, fps: int, *, images: bool) -> int:
    """Write the data set into an empty folder; returns the number of its frames.

    Raises `MachineError` when pyarrow is not installed, and `InputError` when the runs do not fit into one data set.
    """
    arrow = _pyarrow()
    (folder / "meta").mkdir()
    tasks: dict[str, int] = {}
    episodes: list[dict[str, Any]] = []
    stats: list[dict[str, Any]] = []
    first: Frames | None = None
    total = 0
    for number, path in enumerate(paths):
        frames = read_frames(path, fps, images=images)
        first = first or frames
        _require_alike(first, frames, paths[0], path)
        length = len(frames.features["action"].values)
        task = tasks.setdefault(frames.task, len(tasks))
        counters = _counters(length, fps, number, total, task)
        data = folder / "data" / f"chunk-{number // CHUNK:03d}" / f"episode_{number:06d}.parquet"
        data.parent.mkdir(parents=True, exist_ok=True)
        arrow.parquet.write_table(_table(arrow, frames, counters), data, compression="zstd")
        episodes.append({"episode_index": number, "tasks": [frames.task], "length": length})
        stats.append({"episode_index": number, "stats": _stats(frames, counters)})
        total += length
    assert first is not None, "the command line requires at least one file"
    meta = folder / "meta"
    _write_lines(meta / "tasks.jsonl", [{"task_index": index, "task": task} for task, index in tasks.items()])
    _write_lines(meta / "episodes.jsonl", episodes)
    _write_lines(meta / "episodes_stats.jsonl", stats)
    info = _info(first, fps, len(paths), total, len(tasks))
    (meta / "info.json").write_text(json.dumps(info, indent=4) + "\n", encoding="utf-8")
    return total


def _pyarrow() -> Any:
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError as error:
        raise MachineError(
            "--to lerobot writes parquet files, which needs pyarrow: pip install 'dlokit[export]'. "
            "--to npz and --to csv do not need it."
        ) from error


def _require_alike(first: Frames, other: Frames, first_path: Path, path: Path) -> None:
    same = {name: of.names for name, of in first.features.items()} == {
        name: of.names for name, of in other.features.items()
    }
    if not same or first.robots != other.robots:
        raise InputError(
            f"{path} has other robots or another number of nodes than {first_path}: export them separately."
        )


def _counters(length: int, fps: int, episode: int, before: int, task: int) -> dict[str, NDArray[Any]]:
    number = np.arange(length)
    values = (number / fps, number, np.full(length, episode), before + number, np.full(length, task))
    return {name: of.astype(kind) for (name, kind), of in zip(_COUNTERS.items(), values, strict=True)}


def _table(arrow: Any, frames: Frames, counters: Mapping[str, NDArray[Any]]) -> Any:
    arrays: dict[str, Any] = {}
    for name, feature in frames.features.items():
        flat = arrow.array(feature.values.ravel(), type=arrow.float32())
        arrays[name] = arrow.FixedSizeListArray.from_arrays(flat, feature.values.shape[1])
    picture = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
    for name, files in frames.images.items():
        entries = [{"bytes": data, "path": f"frame_{number:06d}.jpg"} for number, data in enumerate(files)]
        arrays[name] = arrow.array(entries, type=picture)
    arrays |= {name: arrow.array(of) for name, of in counters.items()}
    table = arrow.table(arrays)
    # Without it, readers would treat a picture as a pair of bytes and text.
    return table.replace_schema_metadata({"huggingface": json.dumps({"info": {"features": _hf_features(frames)}})})


def _hf_features(frames: Frames) -> dict[str, Any]:
    def value(kind: str) -> dict[str, str]:
        return {"dtype": kind, "_type": "Value"}

    lists = {
        name: {"feature": value("float32"), "length": of.values.shape[1], "_type": "Sequence"}
        for name, of in frames.features.items()
    }
    return lists | {name: {"_type": "Image"} for name in frames.images} | {n: value(k) for n, k in _COUNTERS.items()}


def _stats(frames: Frames, counters: Mapping[str, NDArray[Any]]) -> dict[str, dict[str, Any]]:
    numbers = {name: of.values for name, of in frames.features.items()}
    columns = {name: of[:, None] for name, of in counters.items()}
    found = {name: _stats_of(of.astype(float), (0,)) for name, of in (numbers | columns).items()}
    for name, files in frames.images.items():
        chosen = list(dict.fromkeys(files))[:: max(1, len(set(files)) // PICTURES_OF_STATS)]
        pixels = np.stack([from_jpeg(data)[::PIXELS_OF_STATS, ::PIXELS_OF_STATS] for data in chosen])
        found[name] = _stats_of(pixels.transpose(0, 3, 1, 2) / 255.0, (0, 2, 3))
    return found


def _stats_of(values: NDArray[Any], axes: tuple[int, ...]) -> dict[str, Any]:
    keep = len(axes) > 1  # for pictures: (channels, 1, 1)
    parts = {"min": values.min, "max": values.max, "mean": values.mean, "std": values.std}
    found = {name: of(axis=axes, keepdims=keep) for name, of in parts.items()}
    return {name: (of[0] if keep else of).tolist() for name, of in found.items()} | {"count": [len(values)]}


def _info(frames: Frames, fps: int, episodes: int, total: int, tasks: int) -> dict[str, Any]:
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [of.values.shape[1]], "names": of.names}
        for name, of in frames.features.items()
    }
    for name, files in frames.images.items():
        picture = cv2.imdecode(np.frombuffer(files[0], dtype=np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None, "pictures were read when they were counted"
        features[name] = {"dtype": "image", "shape": list(picture.shape), "names": ["height", "width", "channels"]}
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in _COUNTERS.items()}
    return {
        "codebase_version": VERSION,
        "robot_type": "_".join(frames.robots),
        "total_episodes": episodes,
        "total_frames": total,
        "total_tasks": tasks,
        "total_videos": 0,
        "total_chunks": (episodes - 1) // CHUNK + 1,
        "chunks_size": CHUNK,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": None,
        "features": features,
    }


def _write_lines(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
