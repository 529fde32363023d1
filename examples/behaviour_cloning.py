"""Learn to lay an S from demonstrations of the shipped planner, and compare the result with that planner.

    python examples/behaviour_cloning.py --demonstrations 40 --seeds 3

The policy is about the smallest that behaviour cloning knows: it finds the demonstrated states whose error to the
goal is most like the present one, grasps the nodes that were grasped there, and releases them as far beside their
goals.
Needs the extra `gym`: pip install '.[gym]' in a clone of dlokit.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import tyro

import dlokit
import dlokit.gym
from dlokit.description.shapes import CURVE_POINTS, builtin_shape
from dlokit.gym import Demonstration, PolicyPlanner, ShapeEnv, read_demonstrations, write_demonstrations

LENGTH_M = 0.5
"""Length of the rope."""
MOST_TRIED = 8
"""Demonstrated states that are tried, the most alike first: the gripper may not fit at the nodes of some."""


class NearestDemonstration:
    """A policy for actions with grasp ``node`` and path ``carry``."""

    def __init__(self, demonstrations: Sequence[Demonstration], env: ShapeEnv) -> None:
        """Learn from the steps of the episodes that succeeded."""
        good = [done for done in demonstrations if done.success and len(done.actions)]
        if not good:
            raise dlokit.InputError("no demonstration succeeded; record more.")
        nodes = np.concatenate([done.observations["nodes"][:-1] for done in good])
        goals = np.concatenate([done.observations["goal"][:-1] for done in good])
        self._errors = (goals - nodes)[..., :2]  # (S, M, 2) [m]
        self._vectors = np.concatenate([done.actions for done in good])  # (S, D)
        self._actions = env.actions
        grasped = np.round(0.5 * (self._vectors[:, 0] + 1.0) * (nodes.shape[1] - 1)).astype(int)
        at_goal = goals[np.arange(len(goals)), grasped, :2]
        self._beside = self._vectors[:, 1:3] - self._actions.number_of(at_goal)  # (S, 2) of the release

    def __call__(self, seen: Mapping[str, Any]) -> Iterator[np.ndarray]:
        """Vectors of the action space, from the demonstrated state that is most like the present one."""
        error = (seen["goal"] - seen["nodes"])[:, :2]
        alike = np.argsort(np.sum((self._errors - error) ** 2, axis=(1, 2)), kind="stable")
        for step in alike[:MOST_TRIED]:
            vector = self._vectors[step].copy()
            node = round(0.5 * (float(vector[0]) + 1.0) * (len(error) - 1))
            vector[1:3] = self._actions.number_of(seen["goal"][node, :2]) + self._beside[step]
            yield np.clip(vector, -1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Record, learn, compare."""

    demonstrations: int = 40
    """Episodes of the planner; those that are in the folder already are kept."""
    first_seed: int = 1000
    """Seed of the first of them: other episodes than those of the comparison."""
    folder: Path = Path("demonstrations")
    """Where they are written."""
    seeds: int = 3
    """Random starts of the comparison, each with a cell of its own."""


def main(args: Args) -> None:
    """Write demonstrations, learn from them, and compare with the planner on the same tasks."""
    env = gymnasium.make(dlokit.gym.SHAPE, start="random", goal="S", randomised=True)
    seeds = range(args.first_seed, args.first_seed + args.demonstrations)
    write_demonstrations(env, seeds, args.folder)
    shape_env = env.unwrapped
    assert isinstance(shape_env, ShapeEnv)
    policy = NearestDemonstration(read_demonstrations(args.folder), shape_env)
    env.close()
    planners = {"cloned": PolicyPlanner(policy, shape_env.actions), "rollout": "rollout"}
    goals = builtin_shape("S", LENGTH_M, CURVE_POINTS)[None]
    dlokit.bench.shaping(planners, goals=goals, seeds=args.seeds, randomised=True)  # it prints its tables


if __name__ == "__main__":
    main(tyro.cli(Args))
