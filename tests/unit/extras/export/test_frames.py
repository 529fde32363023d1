"""Frames of a recorded run: what was known, what the arms did next, how it ended."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dlokit.errors import InputError
from dlokit.extras.export.frames import continuous, read_frames
from dlokit.geometry import rmse_m
from dlokit.recording.reader import read_recording
from dlokit.types.flow import RunOutcome
from dlokit.types.robot import RobotState

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
RUN = REFERENCES / "farthest.mcap"
BUDGET = REFERENCES / "wire.mcap"  # ended after its only action


def recorded(topic: str) -> list[Any]:
    return [one.message for one in read_recording(RUN, {topic})]


def test_frames_have_the_state_and_the_next_tool_pose_as_action() -> None:
    frames = read_frames(RUN, 20)
    state, action = frames.features["observation.state"], frames.features["action"]
    assert frames.robots == ("panda",)
    assert state.names is not None
    assert action.names is not None
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


def test_frames_are_evenly_spaced_and_hold_the_last_state_before_their_time() -> None:
    frames = read_frames(RUN, 20)
    assert set(np.diff(frames.times_ns)) == {50_000_000}
    states = list(read_recording(RUN, {"robot/state"}))
    for time_ns, row in zip(frames.times_ns, frames.features["observation.state"].values, strict=True):
        last = [one for one in states if one.log_ns <= time_ns][-1]
        assert isinstance(last.message, RobotState)
        assert time_ns - last.log_ns <= 100_000_000  # the rate of an arm at rest
        np.testing.assert_array_equal(row[:7], last.message.q_rad.astype(np.float32))


def test_no_frame_is_before_the_time_that_is_asked_for() -> None:
    begin_ns = int(read_frames(RUN, 20).times_ns[0]) + 1_000_000_000
    assert read_frames(RUN, 20, first_ns=begin_ns).times_ns[0] == begin_ns


def test_quaternions_do_not_jump_and_are_the_same_rotations() -> None:
    rng = np.random.default_rng(1)
    wxyz = np.array([0.0, -1.0, 0.3, 0.0]) + np.cumsum(rng.normal(size=(200, 4)) * 0.05, axis=0)
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    flipped = wxyz * rng.choice([-1.0, 1.0], size=(200, 1))
    smooth = continuous(flipped)
    assert np.all(np.sum(smooth[1:] * smooth[:-1], axis=1) > 0.9)
    np.testing.assert_allclose(np.abs(np.sum(smooth * wxyz, axis=1)), 1.0)
    assert smooth[0, 1] > 0.0  # as a tool that points down, in every run


def test_the_quaternions_of_a_run_are_continuous() -> None:
    features = read_frames(RUN, 20).features
    for name in ("observation.state", "action"):
        feature = features[name]
        assert feature.names is not None
        first = feature.names.index("first_qw")
        wxyz = feature.values[:, first : first + 4]
        assert np.all(np.sum(wxyz[1:] * wxyz[:-1], axis=1) > 0.9)  # a tool turns less than 50° in 0.05 s


def test_the_reward_is_minus_the_distance_to_the_goal_one_frame_later() -> None:
    features = read_frames(RUN, 20).features
    nodes, goals = (features[f"observation.{name}"].values for name in ("environment_state", "goal"))
    errors_m = [rmse_m(one.reshape(-1, 3), goal.reshape(-1, 3)) for one, goal in zip(nodes, goals, strict=True)]
    reward = features["next.reward"].values
    assert (reward.dtype, reward.shape) == (np.float32, (len(nodes), 1))
    np.testing.assert_allclose(reward[:-1, 0], -np.array(errors_m[1:]), atol=1e-6)
    assert reward[-1] == reward[-2]


@pytest.mark.parametrize(("path", "outcome"), [(RUN, RunOutcome.CONVERGED), (BUDGET, RunOutcome.BUDGET)])
def test_only_the_last_frame_is_done_and_only_a_converged_run_is_a_success(path: Path, outcome: RunOutcome) -> None:
    frames = read_frames(path, 10)
    assert frames.outcome is outcome
    done, success = (frames.features[f"next.{name}"].values[:, 0] for name in ("done", "success"))
    assert done.dtype == success.dtype == np.bool_
    assert np.flatnonzero(done).tolist() == [len(done) - 1]
    assert success[:-1].sum() == 0
    assert success[-1] == (outcome is RunOutcome.CONVERGED)


@pytest.mark.parametrize(("path", "task"), [(RUN, "soft rope into the shape I"), (BUDGET, "wire a into the shape I")])
def test_the_task_names_the_goal(path: Path, task: str) -> None:
    assert read_frames(path, 10).task == f"bring the {task}"


def test_a_run_shorter_than_two_frames_is_refused() -> None:
    last_ns = int(read_frames(RUN, 10).times_ns[-1])
    with pytest.raises(InputError, match="shorter than two frames at 10 per second"):
        read_frames(RUN, 10, first_ns=last_ns)
