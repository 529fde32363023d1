"""Environments whose episodes begin quickly: the camera is not checked, and the planner is the cheap one."""

from typing import Any

import gymnasium
import numpy as np

import dlokit.gym
from dlokit.extras.gym.shape import ShapeEnv
from dlokit.extras.gym.shape_servo import ShapeServoEnv

SETTINGS = {"task.check_camera": False, "cell.settle_s": 0.5, "task.threshold_m": 0.027}
"""One action reaches a straight goal 3 cm beside the straight start: it leaves an error of about 25 mm."""
NEAR: dict[str, Any] = {"start": "I", "goal": "I", "settings": {**SETTINGS, "goal_at_m": (0.55, 0.0)}}
NOWHERE = np.full(8, -1.0, dtype=np.float32)
"""An action with grasp ``place`` and path ``carry`` beside the DLO."""


def _made(name: str, arguments: dict[str, Any]) -> Any:
    return gymnasium.make(name, max_episode_steps=None, disable_env_checker=None, **{**NEAR, **arguments}).unwrapped


def shape_env(**arguments: Any) -> ShapeEnv:
    env = _made(dlokit.gym.SHAPE, {"planner": "farthest", **arguments})
    assert isinstance(env, ShapeEnv)
    return env


def servo_env(**arguments: Any) -> ShapeServoEnv:
    env = _made(dlokit.gym.SHAPE_SERVO, arguments)
    assert isinstance(env, ShapeServoEnv)
    return env


def same(first: dict[str, Any], second: dict[str, Any]) -> bool:
    """Whether two observations are equal to the bit."""
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)
