"""`dlokit.open_run`: the recorded data of a run, as arrays over time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from matplotlib.figure import Figure

from dlokit.app.library.plots import draw_shapes, new_figure, saved
from dlokit.communication import topics
from dlokit.communication.topic import Topic
from dlokit.description.scene import Fixture
from dlokit.errors import InputError
from dlokit.geometry import rmse_m
from dlokit.recording.channels import FILE_NAME, topic_of
from dlokit.recording.reader import RawRecording, Recorded, missing_part, read_recording, recording_file
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.results.run_result import FILE_NAME as RESULT_FILE_NAME
from dlokit.system.results.run_result import ActionResult, RunResult, read_result
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt8Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.message import Message
from dlokit.types.robot import RobotState

T = TypeVar("T", bound=Message)

PLOTTED_SHAPES = 12
"""Shapes that `plot` draws of a run, evenly spaced in time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shapes:
    """The estimated shape over time; arrays have one row for each of T messages."""

    stamp_ns: Int64Array  # (T,)
    nodes_world: Float64Array  # (T, M, 3) [m]
    visible: BoolArray  # (T, M) False before the first look, too
    health: Float64Array  # (T,) from 0 (lost) to 1


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotStates:
    """One robot over time; arrays have one row for each of T messages."""

    stamp_ns: Int64Array  # (T,)
    q_rad: Float64Array  # (T, J)
    dq_rad_s: Float64Array  # (T, J)
    tool_position_world: Float64Array  # (T, 3) [m]
    tool_wxyz: Float64Array  # (T, 4) unit quaternions
    finger_width_m: Float64Array  # (T,)
    holding: BoolArray  # (T,) whether the fingers hold something


@dataclass(frozen=True, kw_only=True, eq=False)
class Clouds:
    """T clouds of the DLO with N points each; N differs from cloud to cloud."""

    stamp_ns: Int64Array  # (T,)
    points_world: tuple[Float32Array, ...]  # (N, 3) [m] each


@dataclass(frozen=True, kw_only=True, eq=False)
class Pictures:
    """T recorded pairs of pictures, RGB."""

    stamp_ns: Int64Array  # (T,)
    left: UInt8Array  # (T, height, width, 3)
    right: UInt8Array  # (T, height, width, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPictures:
    """T recorded images of a depth camera."""

    stamp_ns: Int64Array  # (T,)
    pixels: UInt8Array  # (T, height, width, 3) RGB
    depth_m: Float32Array  # (T, height, width) [m]; 0 where unknown


class Recording:
    """A recorded run. Data are read on first access and then kept.

    Iterate over it for the messages themselves, in order of arrival.
    """

    def __init__(self, path: Path) -> None:
        """`path` is the file; `open_run` finds it in a run's folder."""
        self.path = path

    @cached_property
    def state(self) -> Shapes:
        """The shape that convergence and planning used: the model's, after tracking."""
        return self._shapes(self._of(topics.STATE))

    @cached_property
    def targets(self) -> Shapes:
        """The observer's target points."""
        return self._shapes(self._of(topics.TARGETS))

    @cached_property
    def goal(self) -> Float64Array | None:
        """The last goal (M, 3) [m]; None if no goal was set."""
        goals = self._of(topics.GOAL)
        return goals[-1].nodes_world if goals else None

    @cached_property
    def fixtures(self) -> tuple[Fixture, ...]:
        """The fixtures that the system believed to be on the table; none if the recording has no readable settings."""
        try:
            return recorded_config(self.path, ()).installation.fixtures
        except InputError:
            return ()

    @cached_property
    def robots(self) -> dict[str, RobotStates]:
        """Each robot's states by its name; the first robot's first."""
        found: dict[str, list[RobotState]] = {}
        recorded = [topic for name in self.topics if (topic := topic_of(name)) is not None]
        for topic in sorted(recorded, key=lambda topic: topic.instance):  # the first robot's instance is empty
            if topic.row == topics.ROBOT_STATE.row:
                states = cast(list[RobotState], self._of(topic))
                found[states[0].robot] = states
        return {name: _robot(states) for name, states in found.items()}

    @property
    def robot(self) -> RobotStates:
        """The states of the only robot, or of the first one. Raises `InputError` if none was recorded."""
        if not self.robots:
            raise InputError(f"{self.path} has no states of a robot.")
        return next(iter(self.robots.values()))

    @cached_property
    def clouds(self) -> Clouds:
        """The DLO's points, as the observer got them."""
        seen = self._of(topics.OBSERVATION)
        return Clouds(stamp_ns=_stamps(seen), points_world=tuple(cloud.points_world for cloud in seen))

    @cached_property
    def pictures(self) -> Pictures:
        """The pairs of pictures, at most two per second. A minute of them takes some 200 MB of memory."""
        pairs = self._of(topics.STEREO_IMAGES)
        empty = np.empty((0, 0, 0, 3), dtype=np.uint8)
        return Pictures(
            stamp_ns=_stamps(pairs),
            left=np.stack([pair.left for pair in pairs]) if pairs else empty,
            right=np.stack([pair.right for pair in pairs]) if pairs else empty,
        )

    @cached_property
    def depth_pictures(self) -> DepthPictures:
        """The images of a depth camera, at most two per second. A minute of them takes some 260 MB of memory."""
        images = self._of(topics.DEPTH_IMAGES)
        return DepthPictures(
            stamp_ns=_stamps(images),
            pixels=np.stack([one.pixels for one in images]) if images else np.empty((0, 0, 0, 3), dtype=np.uint8),
            depth_m=np.stack([one.depth_m for one in images]) if images else np.empty((0, 0, 0), dtype=np.float32),
        )

    @cached_property
    def missing(self) -> str:
        """Description of the unreadable parts of the recording; empty if it is complete."""
        return missing_part(self.path)

    @cached_property
    def result(self) -> RunResult | None:
        """The run's `result.json`; None if the run was killed before it wrote one."""
        folder = self.path.parent
        return read_result(folder) if (folder / RESULT_FILE_NAME).exists() else None

    @property
    def actions(self) -> tuple[ActionResult, ...]:
        """The actions with their errors and times; empty if there is no result."""
        return () if self.result is None else self.result.history

    @cached_property
    def topics(self) -> dict[str, int]:
        """The number of messages by topic."""
        counts: dict[str, int] = {}
        for channel, _ in RawRecording(path=self.path):
            if topic_of(channel) is not None:
                counts[channel] = counts.get(channel, 0) + 1
        return counts

    def messages(self, topic: str) -> list[Recorded]:
        """All messages of a topic by its name, e.g. ``"planning/action"``. Raises `InputError` for an unknown one."""
        if topic_of(topic) is None:
            raise InputError(
                f"no topic {topic!r} is known; {self.path} has {', '.join(self.topics)}. The topic of another package "
                "needs that package, with its entry point dlokit.topics."
            )
        return list(read_recording(self.path, only={topic}))

    def __iter__(self) -> Iterator[Recorded]:
        return read_recording(self.path)

    def plot(self, path: Path | str | None = None) -> Figure:
        """Draw the shapes from above and the error to the goal over time; save the figure where a `path` is given."""
        state, goal = self.state, self.goal
        shown = np.unique(np.linspace(0, max(len(state.stamp_ns) - 1, 0), PLOTTED_SHAPES).astype(np.int64))
        shapes = [state.nodes_world[row] for row in shown] if len(state.stamp_ns) else []
        figure, axes = new_figure(columns=1 if goal is None else 2)
        start = shapes[0] if shapes else None
        draw_shapes(axes[0], goal=goal, start=start, shapes=shapes[1:], fixtures=self.fixtures)
        if goal is not None:
            t_s = (state.stamp_ns - state.stamp_ns[:1].sum()) / 1e9
            axes[1].plot(t_s, [rmse_m(nodes, goal) * 1000.0 for nodes in state.nodes_world])
            axes[1].set_xlabel("time since the first state [s]")
            axes[1].set_ylabel("RMSE to the goal [mm]")
            axes[1].set_ylim(bottom=0.0)
            axes[1].grid(alpha=0.3)
        return saved(figure, path)

    def __fspath__(self) -> str:
        """The run's folder, so that a recording can be passed wherever a run's path is expected."""
        return str(self.path.parent)

    def __repr__(self) -> str:
        outcome = "no result" if self.result is None else self.result.outcome.value
        return f"<Recording {self.path}: {outcome}, {sum(self.topics.values())} messages>"

    def _of(self, topic: Topic[T]) -> list[T]:
        """The messages of a topic, without their log entries."""
        return [cast(T, one.message) for one in self.messages(topic.name)]

    @staticmethod
    def _shapes(found: Sequence[DloState] | Sequence[TargetPoints]) -> Shapes:
        count = len(found[0].nodes_world) if found else 0
        hidden = np.zeros(count, dtype=np.bool_)
        return Shapes(
            stamp_ns=_stamps(found),
            nodes_world=np.array([one.nodes_world for one in found]).reshape(-1, count, 3),
            visible=np.array([hidden if one.visible is None else one.visible for one in found]).reshape(-1, count),
            health=np.array([one.health for one in found], dtype=np.float64),
        )


def open_run(path: Path | str | PathLike[str]) -> Recording:
    """Open the recording of a run: its folder, or the file `recording.mcap` itself.

    Only the head of the file is read. Raises `InputError` if there is no recording.
    """
    path = Path(path).expanduser()
    file = recording_file(path)
    if not path.exists():
        raise InputError(f"{path} does not exist: give the folder of a run, e.g. runs/<time>-I-to-S.")
    if not file.exists():
        raise InputError(f"{path} holds no {FILE_NAME}: give the folder of a run that was recorded.")
    raw = RawRecording(path=file)
    next(iter(raw), None)
    raw.require_own()
    return Recording(file)


def _stamps(messages: Sequence[Message]) -> Int64Array:
    return np.array([message.stamp_ns for message in messages], dtype=np.int64)


def _robot(states: list[RobotState]) -> RobotStates:
    return RobotStates(
        stamp_ns=_stamps(states),
        q_rad=np.array([state.q_rad for state in states]),
        dq_rad_s=np.array([state.dq_rad_s for state in states]),
        tool_position_world=np.array([state.T_world_tcp.position_m for state in states]),
        tool_wxyz=np.array([state.T_world_tcp.wxyz for state in states]),
        finger_width_m=np.array([state.finger_width_m for state in states]),
        holding=np.array([state.holding for state in states]),
    )
