"""A recorded run as frames at a constant rate: the known quantities, the arms' next motion, and the run's outcome."""

from collections import defaultdict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.geometry import rmse_m
from dlokit.recording.channels import ChannelsOf
from dlokit.recording.reader import read_recording
from dlokit.system.config import INTERACTIVE, RunConfig
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.results.run_result import read_result
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.flow import FlowStatus, RunOutcome
from dlokit.types.robot import RobotState

STATE, ACTION = "observation.state", "action"
REWARD, DONE, SUCCESS = "next.reward", "next.done", "next.success"
SHAPES = {
    topics.STATE.name: "observation.environment_state",
    topics.TARGETS.name: "observation.targets",
    topics.GOAL.name: "observation.goal",
}
"""Feature name by topic; the coordinates of all nodes (M, 3) are concatenated."""
_TOOL = ("x", "y", "z", "qw", "qx", "qy", "qz", "finger_width")
_TOOL_DOWN_WXYZ = np.array([0.0, 1.0, 0.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One quantity over all frames."""

    names: list[str] | None
    """Names of its components; None for a single number."""
    values: NDArray[Any]
    """(T, n) float32 or bool: lengths [m], angles [rad]."""


@dataclass(frozen=True, kw_only=True)
class Frames:
    """The frames of one run, without pictures."""

    times_ns: Int64Array  # (T,) on the run's clock [ns]
    task: str
    """Description of the task in words."""
    robots: tuple[str, ...]
    """The arms' models: panda, fr3, ur5e or the name of a file; the arms' names if the recording lacks its settings."""
    features: dict[str, Feature]
    outcome: RunOutcome | None
    """Outcome of the run; None if neither the recording nor the result.json beside it contains it."""


@dataclass
class _Series:
    """The published values of one quantity, with their times."""

    log_ns: list[int] = field(default_factory=list[int])
    values: list[Any] = field(default_factory=list[Any])

    def at(self, times_ns: Int64Array) -> list[Any]:
        """The latest value published until each time."""
        places = np.searchsorted(self.log_ns, times_ns, side="right") - 1
        return [self.values[place] for place in places]


def read_frames(path: Path, fps: int, *, first_ns: int = 0) -> Frames:
    """Sample a recording at `fps` frames per second of its clock, from the time when all quantities are known.

    Each value is the latest one published before its frame; no frame is before `first_ns`. The action of a frame is the
    poses of the tools and the widths of their fingers one frame later. The reward is minus the model's distance to the
    goal one frame later. Raises `InputError` if robot, shape or goal are not in the recording.
    """
    recorded = _recorded(path)
    statuses = recorded.pop(topics.FLOW.name, _Series()).values
    robots = sorted(channel for channel in recorded if channel.startswith(topics.ROBOT_STATE.name))
    if missing := [name for name in (topics.ROBOT_STATE.name, *SHAPES) if name not in recorded]:
        raise InputError(f"{path} contains no {', '.join(missing)}; give the recording of a run that observed the DLO.")
    times_ns = _times_ns(path, fps, first_ns, recorded.values())
    states = [cast(list[RobotState], recorded[robot].at(times_ns)) for robot in robots]
    shapes, goals = recorded[topics.STATE.name].at(times_ns), recorded[topics.GOAL.name].at(times_ns)
    outcome = _outcome(statuses, path.parent)
    config = known_config(path, ("cell", "camera", "driver", "dry_run", "twin"))
    return Frames(
        times_ns=times_ns,
        task=_task(config, goals[-1]),
        robots=_models(config, len(states)) or tuple(one[0].robot for one in states),
        features=_robot_features(states)
        | {feature: _nodes(recorded[name].at(times_ns)) for name, feature in SHAPES.items()}
        | _results(shapes, goals, outcome),
        outcome=outcome,
    )


def known_config(path: Path, parts: tuple[str, ...]) -> RunConfig | None:
    """Parts of a run's settings; None if the recording has no readable settings."""
    try:
        return recorded_config(path, parts)
    except InputError:
        return None


def _models(config: RunConfig | None, robots: int) -> tuple[str, ...]:
    """The models of a run's arms; empty if its settings are unknown."""
    if config is None:
        return ()
    models = [config.arm or mounted.model for mounted in config.installation.arms[:robots]]
    return tuple(Path(model).stem for model in models) if len(models) == robots else ()


def _task(config: RunConfig | None, goal: GoalShape) -> str:
    """Description of the task for training a language-conditioned model: one text for each goal."""
    simulated = config is not None and config.camera.sees_cell
    dlo = config.cell.dlo.name.replace("_", " ").replace("-", " ") if config is not None and simulated else "DLO"
    if goal.name == INTERACTIVE:
        return f"bring the {dlo} into the shape that the operator drew"
    return f"bring the {dlo} into the shape {Path(goal.name).stem}"


def _recorded(path: Path) -> dict[str, _Series]:
    found: defaultdict[str, _Series] = defaultdict(_Series)
    for one in read_recording(path, ChannelsOf((topics.ROBOT_STATE.name, topics.FLOW.name, *SHAPES))):
        found[one.topic].log_ns.append(one.log_ns)
        found[one.topic].values.append(one.message)
    return dict(found)


def _times_ns(path: Path, fps: int, first_ns: int, series: Iterable[_Series]) -> Int64Array:
    spans = [(one.log_ns[0], one.log_ns[-1]) for one in series]
    first, last = max(first_ns, *(begin for begin, _ in spans)), max(end for _, end in spans)
    count = (last - first) * fps // 1_000_000_000 + 1
    if count < 2:
        raise InputError(
            f"{path} is shorter than two frames at {fps} per second; give a longer run, or a higher --fps."
        )
    return first + np.arange(count) * 1_000_000_000 // fps


def _robot_features(states: list[list[RobotState]]) -> dict[str, Feature]:
    """Features of the states (T,) of each robot: joints and tool now, and the tool one frame later."""
    tools = [_tools(one) for one in states]
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


def _tools(states: list[RobotState]) -> Float64Array:
    """Position [m], quaternion and finger width [m] of a tool (T, 8)."""
    positions_m = np.array([state.T_world_tcp.position_m for state in states])
    wxyz = continuous(np.array([state.T_world_tcp.wxyz for state in states]))
    return np.hstack([positions_m, wxyz, np.array([[state.finger_width_m] for state in states])])


def continuous(wxyz: Float64Array) -> Float64Array:
    """The same rotations as quaternions (T, 4) without jumps: of q and -q, the one nearer to the previous quaternion.

    The first is the one nearer to a tool that points straight down, so that all runs begin alike.
    """
    before = np.vstack([_TOOL_DOWN_WXYZ, wxyz[:-1]])
    flips = np.where(np.sum(before * wxyz, axis=1) < 0.0, -1.0, 1.0)
    return wxyz * np.cumprod(flips)[:, None]


def _nodes(messages: list[Any]) -> Feature:
    nodes = np.array([message.nodes_world for message in messages], dtype=np.float32)
    names = [f"node{node}_{axis}" for node in range(nodes.shape[1]) for axis in "xyz"]
    return Feature(names=names, values=nodes.reshape(len(nodes), -1))


def _outcome(statuses: list[FlowStatus], folder: Path) -> RunOutcome | None:
    outcome = next((status.outcome for status in reversed(statuses) if status.outcome is not None), None)
    if outcome is None:  # killed, or the end of the recording is lost
        with suppress(InputError):
            return read_result(folder).outcome
    return outcome


def _results(shapes: list[DloState], goals: list[GoalShape], outcome: RunOutcome | None) -> dict[str, Feature]:
    """Reward, end and success (T, 1) that each frame leads to."""
    errors_m = np.array(
        [
            rmse_m(shape.nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
            for shape, goal in zip(shapes, goals, strict=True)
        ]
    )
    reward = -np.append(errors_m[1:], errors_m[-1]).astype(np.float32)
    done = np.arange(len(reward)) == len(reward) - 1
    columns = {REWARD: reward, DONE: done, SUCCESS: done & (outcome is RunOutcome.CONVERGED)}
    return {name: Feature(names=None, values=values[:, None]) for name, values in columns.items()}
