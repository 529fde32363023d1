"""A recorded run as frames at a steady rate: what the robot and the DLO were, and where the tool went next."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.recording.channels import topic_of
from dlokit.recording.reader import RawRecording, picture_file, read_recording
from dlokit.types.arrays import Float32Array, Float64Array, Int64Array
from dlokit.types.robot import RobotState

STATE, ACTION = "observation.state", "action"
SHAPES = {
    topics.STATE.name: "observation.environment_state",
    topics.TARGETS.name: "observation.targets",
    topics.GOAL.name: "observation.goal",
}
"""Feature by topic: all nodes (M, 3), one behind the other."""
IMAGES = {"view/left": "observation.images.left", "view/right": "observation.images.right"}
_TOOL = ("x", "y", "z", "qw", "qx", "qy", "qz", "finger_width")


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One thing over all frames."""

    names: list[str]
    """Of each of its numbers."""
    values: Float32Array  # (T, n) lengths [m], angles [rad]


@dataclass(frozen=True, kw_only=True)
class Frames:
    """One run."""

    task: str
    """What was to be done, in words."""
    robots: tuple[str, ...]
    features: dict[str, Feature]
    images: dict[str, list[bytes]]
    """By feature, T files: the last that was taken by then."""


@dataclass
class _Series:
    """What was told of one thing, and when."""

    log_ns: list[int] = field(default_factory=list[int])
    values: list[Any] = field(default_factory=list[Any])

    def at(self, times_ns: Int64Array) -> list[Any]:
        """The last value told by each time."""
        places = np.searchsorted(self.log_ns, times_ns, side="right") - 1
        return [self.values[place] for place in places]


def read_frames(path: Path, fps: int, *, images: bool) -> Frames:
    """Sample a recording `fps` times a second of its clock, from when everything was known to its end.

    Each value is the last one that was told by then. The action of a frame is where the tools are, and how wide their
    fingers, one frame later. Raises `InputError` when robot, shape, goal or pictures are not in the recording.
    """
    told = _told(path)
    raw = RawRecording(path=path)
    pictures = _pictures(raw)  # read through in any case: the metadata is filled meanwhile
    robots = sorted(channel for channel in told if channel.startswith(topics.ROBOT_STATE.name))
    needed = (topics.ROBOT_STATE.name, *SHAPES, *(IMAGES if images else ()))
    if missing := [name for name in needed if name not in told and name not in pictures]:
        raise InputError(
            f"{path} holds nothing of {', '.join(missing)}; give the recording of a run that saw the DLO"
            + (", or leave pictures away with --no-images." if images else ".")
        )
    series = told | (pictures if images else {})
    times_ns = _times_ns(path, fps, series.values())
    states = [cast(list[RobotState], told[robot].at(times_ns)) for robot in robots]
    return Frames(
        task=f"shape the DLO: {raw.metadata.get('run', {}).get('name', 'to the goal')}",
        robots=tuple(one[0].robot for one in states),
        features=_robot_features(states) | {feature: _nodes(told[name], times_ns) for name, feature in SHAPES.items()},
        images={IMAGES[name]: of.at(times_ns) for name, of in pictures.items() if images},
    )


class _Wanted:
    """The topics that frames are made of, whosever they are."""

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in (topics.ROBOT_STATE.name, *SHAPES)


def _told(path: Path) -> dict[str, _Series]:
    found: defaultdict[str, _Series] = defaultdict(_Series)
    for one in read_recording(path, _Wanted()):
        found[one.topic].log_ns.append(one.log_ns)
        found[one.topic].values.append(one.message)
    return dict(found)


def _pictures(raw: RawRecording) -> dict[str, _Series]:
    found: defaultdict[str, _Series] = defaultdict(_Series)
    for channel, record in raw:
        if channel in IMAGES:
            found[channel].log_ns.append(record.log_time)
            found[channel].values.append(picture_file(record.data).data)
    return dict(found)


def _times_ns(path: Path, fps: int, series: Iterable[_Series]) -> Int64Array:
    spans = [(one.log_ns[0], one.log_ns[-1]) for one in series]
    first, last = max(begin for begin, _ in spans), max(end for _, end in spans)
    count = (last - first) * fps // 1_000_000_000 + 1
    if count < 2:
        raise InputError(f"{path} is shorter than two frames at {fps} a second; give a longer run, or a higher --fps.")
    return first + np.arange(count) * 1_000_000_000 // fps


def _robot_features(states: list[list[RobotState]]) -> dict[str, Feature]:
    """Of each robot's states (T,): joints and tool now; tool one frame later."""
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
