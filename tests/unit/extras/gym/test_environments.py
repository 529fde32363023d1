"""Both environments: Gymnasium's own checker, seeds, ends, pictures, saved states, and what is privileged."""

import asyncio
import gc
import importlib
import sys
import tempfile
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from quick_environments import NEAR, NOWHERE, SETTINGS, same, servo_env, shape_env

from dlokit.errors import BadValue, ConfigError, DlokitError, MachineError, ShapeError
from dlokit.extras.gym.environment import DloEnvironment
from dlokit.system.lockstep import run_lockstep
from dlokit.system.shaping import Watcher

TO_AND_HOLD = np.array([0.6, 0.0, 0.0, 0.0, 1.0], dtype=np.float32)
"""3 cm along x in half a second, the fingers closed."""
OPEN = np.array([0.0, 0.0, 0.0, 0.0, -1.0], dtype=np.float32)


@pytest.mark.heavy
@pytest.mark.parametrize("make", [pytest.param(shape_env, marks=pytest.mark.long), servo_env])
def test_gymnasium_finds_nothing_wrong(make: Any) -> None:
    settings = {**NEAR["settings"], "cell.settle_s": 0.1}
    env = make(render_mode="rgb_array", privileged=True, observation=("nodes", "cloud", "picture"), settings=settings)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)
    env.close()


@pytest.mark.heavy
def test_success_terminates_and_equal_seeds_give_equal_episodes() -> None:
    env = shape_env(render_mode="rgb_array")
    first, info = env.reset(seed=5)
    assert not info["is_success"]
    assert info["seed"] == 5
    assert info["rmse_m"] == pytest.approx(0.03, abs=0.003)  # 3 cm, seen by the camera
    action = env.expert()
    assert action is not None
    after, reward, terminated, truncated, info = env.step(action)
    assert (terminated, truncated) == (True, False)
    assert info["is_success"]
    assert info["outcome"] == "converged"
    assert info["grasp_ok"]
    assert reward > 1.0  # the progress, and 1 for success
    with pytest.raises(ResetNeeded):
        env.step(action)
    # Again, with all that must not change an episode: no expert asked, pictures drawn.
    again, _ = env.reset(seed=5)
    env.render()
    assert same(first, again)
    again, reward_again, *_ = env.step(action)
    assert same(after, again)
    assert reward == reward_again
    other, _ = env.reset(seed=6)
    assert not same(first, other)
    env.close()


def test_a_refused_action_moves_nothing_and_the_budget_truncates() -> None:
    env = shape_env(grasp="place", max_actions=2, reward="sparse")
    before, _ = env.reset(seed=0)
    after, reward, terminated, truncated, info = env.step(NOWHERE)
    assert same(before, after)
    assert (reward, terminated, truncated) == (0.0, False, False)
    assert info["refused"] == "beside_the_dlo"
    with pytest.raises(BadValue, match="finite numbers"):
        env.step(np.full(8, np.nan, dtype=np.float32))
    _, _, terminated, truncated, info = env.step(NOWHERE)
    assert (terminated, truncated) == (False, True)
    assert info["outcome"] == "budget"
    assert not info["is_success"]
    env.close()


def test_a_saved_episode_comes_back_to_the_bit_and_goes_on_the_same() -> None:
    precise = {"settings": {**NEAR["settings"], "task.threshold_m": 0.012}}  # no success in these steps
    env = servo_env(**precise)
    env.reset(seed=3)
    env.step(TO_AND_HOLD)
    state = env.save()
    later = [env.step(action) for action in (OPEN, OPEN)]
    other = servo_env(**precise)
    other.reset(seed=8)
    seen, info = other.restore(state)
    assert info["steps"] == 1
    for (expected, expected_reward, *_), action in zip(later, (OPEN, OPEN), strict=True):
        seen, reward, *_ = other.step(action)
        assert same(seen, expected)
        assert reward == expected_reward
    assert env.np_random.integers(2**31) == other.np_random.integers(2**31)
    with pytest.raises(ConfigError, match="other arguments"):
        servo_env(**precise, speed_m_s=0.05).restore(state)
    env.close()
    other.close()


def test_the_tool_carries_the_dlo_and_success_is_that_it_lies_there_released() -> None:
    env = servo_env()
    seen, _ = env.reset(seed=0)
    assert seen["tool"][6] == 1.0  # it holds the DLO
    moved, reward, terminated, _, info = env.step(TO_AND_HOLD)
    assert moved["tool"][0] - seen["tool"][0] == pytest.approx(0.03, abs=0.002)
    assert reward > 0.0
    assert not terminated  # it is still held
    assert info["holding"]
    steps = 0
    while not terminated and steps < 4:
        seen, _, terminated, truncated, info = env.step(OPEN)
        assert not truncated
        steps += 1
    assert terminated
    assert info["is_success"]
    assert seen["tool"][6] == 0.0
    env.close()


def test_the_arm_may_begin_above_the_dlo_and_grasp_it_later() -> None:
    env = servo_env(held=False, speed_m_s=0.12, max_steps=3)
    seen, _ = env.reset(seed=0)
    assert seen["tool"][2] > 0.06
    down = np.array([0.0, 0.0, -1.0, 0.0, -1.0], dtype=np.float32)
    seen, _, _, _, info = env.step(down)
    assert seen["tool"][2] < 0.013
    _, _, _, truncated, info = env.step(TO_AND_HOLD)
    assert info["holding"]
    assert not truncated
    far = np.array([1.0, 1.0, 1.0, 1.0, 1.0], dtype=np.float32)
    _, _, _, truncated, info = env.step(far)
    assert truncated
    assert info["outcome"] == "budget"
    env.close()


ALL_SEEN: dict[str, Any] = {
    "grasp": "place",
    "privileged": True,
    "observation": ("nodes", "cloud", "picture"),
    "cloud_points": 300,
}


@dataclass(frozen=True)
class Seen:
    """All that an environment shows at the begin of an episode, for several tests."""

    seen: dict[str, Any]
    info: dict[str, Any]
    shown: Any
    after: dict[str, Any]
    """The observation after an action that was refused."""


@pytest.fixture(scope="module")
def begin() -> Seen:
    env = shape_env(**ALL_SEEN, render_mode="rgb_array")
    seen, info = env.reset(seed=0)
    assert env.observation_space.contains(seen)
    shown = env.render()
    after, *_ = env.step(NOWHERE)
    env.close()
    return Seen(seen, info, shown, after)


def test_true_nodes_are_seen_only_where_they_are_asked_for(begin: Seen) -> None:
    for env in (shape_env(), servo_env()):
        assert isinstance(env.observation_space, gymnasium.spaces.Dict)
        assert not [name for name in env.observation_space.spaces if "true" in name]
    seen, info = begin.seen, begin.info
    away_m = np.linalg.norm(seen["privileged_true_nodes"] - seen["nodes"], axis=1)
    assert away_m.max() < 0.02  # in the same order; the camera is off by 3 mm
    assert not np.array_equal(seen["privileged_true_nodes"], seen["nodes"])
    assert info["privileged_true_rmse_m"] == pytest.approx(info["rmse_m"], abs=0.005)


def test_what_is_seen_can_be_chosen() -> None:
    env = shape_env(observation=("cloud", "picture"))
    assert isinstance(env.observation_space, gymnasium.spaces.Dict)
    assert sorted(env.observation_space.spaces) == ["cloud", "goal", "picture"]


def test_cloud_and_picture_are_those_of_the_camera(begin: Seen) -> None:
    cloud = begin.seen["cloud"]
    assert len(cloud) == 300
    assert abs(float(np.median(cloud[:, 0])) - 0.52) < 0.02  # the straight start, in the middle of the table
    assert np.ptp(cloud[:, 1]) > 0.45
    assert begin.seen["picture"].std() > 5.0


def test_the_picture_shows_goal_and_nodes(begin: Seen) -> None:
    green = np.all(np.abs(begin.shown.astype(int) - (60, 200, 90)) < 25, axis=2)
    yellow = np.all(np.abs(begin.shown.astype(int) - (250, 200, 40)) < 25, axis=2)
    assert green.sum() > 100
    assert yellow.sum() > 100


def test_an_environment_works_in_a_running_event_loop(begin: Seen) -> None:
    async def notebook() -> tuple[Any, Any]:
        env = shape_env(**ALL_SEEN)
        seen, _ = env.reset(seed=0)
        after, *_ = env.step(NOWHERE)
        env.close()
        return seen, after

    seen, after = asyncio.run(notebook())
    assert same(begin.seen, seen)
    assert same(begin.after, after)


def test_an_environment_that_is_dropped_ends_its_components() -> None:
    env = shape_env()
    env.reset(seed=0)
    del env
    gc.collect()  # warnings are errors here: an event loop that is left open warns


def test_a_start_at_the_goal_is_no_episode() -> None:
    env = shape_env(goal="I", settings=SETTINGS)
    with pytest.raises(ShapeError, match="the start is at the goal"):
        env.reset(seed=0, options={"start": "I"})
    seen, _ = env.reset(seed=0, options={"goal": np.column_stack([np.full(20, 0.6), np.linspace(-0.25, 0.25, 20)])})
    assert seen["goal"][:, 0] == pytest.approx(np.full(31, 0.6), abs=1e-6)
    env.close()


@pytest.mark.parametrize(
    "wrong",
    [
        {"reward": "dense"},
        {"observation": ("nodes", "truth")},
        {"grasp": "end"},
        {"max_actions": 0},
        {"cloud_points": 0},
        {"randomised": ("gravity",)},
        {"settings": {"arms": 2}},
        {"camera": "realsense"},
        {"planner": "cleverest"},
    ],
)
def test_an_argument_that_cannot_work_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        shape_env(**wrong)
    with pytest.raises(ConfigError):
        servo_env(period_s=0.0)


def test_options_that_are_unknown_are_refused() -> None:
    with pytest.raises(ConfigError, match="start and goal"):
        shape_env().reset(options={"friction": 0.3})


def test_a_component_that_fails_truncates_the_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    env = servo_env()
    before, _ = env.reset(seed=0)
    course = env._course  # pyright: ignore[reportPrivateUsage]
    assert course is not None

    def diverge(*_: object) -> None:
        raise DlokitError("the physics diverged")

    monkeypatch.setattr(course.stepped.cell._cell, "step", diverge)  # pyright: ignore[reportPrivateUsage]
    seen, reward, terminated, truncated, info = env.step(TO_AND_HOLD)
    assert same(before, seen)
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert info["outcome"] == "failed"
    assert "diverged" in info["reason"]
    env.close()


@pytest.mark.parametrize("mode", list(gymnasium.vector.AutoresetMode)[:2])
def test_both_ways_to_reset_ended_episodes_of_a_vector(mode: gymnasium.vector.AutoresetMode) -> None:
    arguments: dict[str, Any] = {**NEAR, "grasp": "place", "max_actions": 1}
    envs = gymnasium.make_vec(
        "dlokit/Shape-v0",
        wrappers=None,
        num_envs=2,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **arguments,
    )
    first, _ = envs.reset(seed=0)
    assert first["nodes"].shape == (2, 31, 3)
    assert not np.array_equal(first["nodes"][0], first["nodes"][1])
    actions = np.stack([NOWHERE, NOWHERE])
    second, _, _, truncated, info = envs.step(actions)
    assert truncated.all()
    if mode is gymnasium.vector.AutoresetMode.SAME_STEP:
        assert np.array_equal(info["final_obs"][0]["nodes"], first["nodes"][0])
        assert not np.array_equal(second["nodes"], first["nodes"])
    else:
        assert np.array_equal(second["nodes"], first["nodes"])
        third, _, _, truncated, _ = envs.step(actions)
        assert not truncated.any()
        assert not np.array_equal(third["nodes"], first["nodes"])
    envs.close()


def test_an_environment_is_made_by_its_name_alone() -> None:
    env = gymnasium.make("dlokit.gym:dlokit/ShapeServo-v0")
    assert isinstance(env.unwrapped, DloEnvironment)
    env.close()


def test_an_episode_begins_as_the_run_with_its_seed() -> None:
    env = shape_env()
    seen, _ = env.reset(seed=11)
    run, job = env._episodes.job(11, {})  # pyright: ignore[reportPrivateUsage]
    run = replace(run, task=replace(run.task, max_time_s=0.001))  # it ends before its first action
    with tempfile.TemporaryDirectory() as folder:
        start = run_lockstep(run, job, Path(folder), Watcher()).start_nodes_world
    assert start is not None
    assert np.array_equal(start.astype(np.float32), seen["nodes"])
    env.close()


def test_without_gymnasium_the_import_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "dlokit.gym")
    monkeypatch.delitem(sys.modules, "dlokit.extras.gym")
    with pytest.raises(MachineError, match=r"dlokit\.gym needs dlokit's extra `gym`.*\[gym\]"):
        importlib.import_module("dlokit.gym")
