"""What the expert shows, and a policy in place of a planner."""

import asyncio
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from quick_environments import same, servo_env, shape_env

from dlokit.description.arm.franka import PANDA
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError, InputError
from dlokit.extras.gym.demonstrations import Demonstration, demonstrate, read_demonstrations, write_demonstrations
from dlokit.extras.gym.policy_planner import PolicyPlanner
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.skills.observer.anchored import chain
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.types.action import Action, Marks
from dlokit.types.dlo import DloState, GoalShape


@pytest.mark.heavy
def test_the_expert_shows_episodes_that_can_be_repeated(tmp_path: Path) -> None:
    env = shape_env()
    (path,) = write_demonstrations(env, [7], tmp_path)
    (shown,) = read_demonstrations(tmp_path)
    assert shown.success
    assert shown.seed == 7
    assert shown.actions.shape == (1, 7)
    assert shown.observations["nodes"].shape == (2, 31, 3)
    assert shown.rmse_m[1] < shown.rmse_m[0]
    seen, _ = env.reset(seed=7)
    assert np.array_equal(seen["nodes"], shown.observations["nodes"][0])
    after, reward, *_ = env.step(shown.actions[0])
    assert same(after, {name: values[1] for name, values in shown.observations.items()})
    assert reward == shown.rewards[0]
    written_ns = path.stat().st_mtime_ns
    write_demonstrations(env, [7], tmp_path)
    assert path.stat().st_mtime_ns == written_ns  # kept
    env.close()


def test_where_there_is_nobody_to_show_or_nothing_shown_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has no expert"):
        demonstrate(servo_env(), 0)
    with pytest.raises(InputError, match="write_demonstrations"):
        read_demonstrations(tmp_path)


def test_a_policy_is_a_planner_whose_impossible_and_marked_actions_are_skipped() -> None:
    env = shape_env()
    nodes, goal = builtin_shape("I", 0.5, 31), builtin_shape("S", 0.5, 31)
    asked: list[dict[str, Any]] = []
    far, marked, good = (np.zeros(7, dtype=np.float32) for _ in range(3))
    far[1:3] = 1.0
    marked[0] = -0.5
    marked[3] = 0.1

    def policy(seen: Any) -> Iterator[Any]:
        asked.append(seen)
        yield from (far, marked, good)

    tools = PlanningTools(reachable=ArmKinematics(PANDA).reachable, actions=ActionConfig())
    state = DloState(stamp_ns=5, nodes_world=nodes, topology=chain(31, 0.5))
    at_marked = env.actions.decode(marked, nodes, tools)
    assert not isinstance(at_marked, str)
    marks = Marks(invalid_nodes=np.array([at_marked.grasp.node]))

    async def proposed() -> list[Action]:
        strategy = PolicyPlanner(policy, env.actions).build(tools)
        goal_shape = GoalShape(stamp_ns=5, nodes_world=goal)
        return [action async for action in strategy.propose(state, goal_shape, marks)]

    (action,) = asyncio.run(proposed())
    assert action.grasp.node == 15
    assert action.stamp_ns == 5
    assert action.predicted_nodes_world is not None
    assert np.array_equal(asked[0]["goal"], goal.astype(np.float32))


def test_the_example_grasps_where_it_was_shown_and_releases_as_far_beside_the_goal() -> None:
    example = runpy.run_path(str(Path(__file__).parents[4] / "examples" / "behaviour_cloning.py"))
    env = shape_env()
    nodes, goal = (builtin_shape(name, 0.5, 31).astype(np.float32) for name in ("I", "S"))
    vector = np.zeros(7, dtype=np.float32)
    vector[0] = 2.0 * 6 / 30 - 1.0
    beside_m = np.array([0.01, -0.02])
    vector[1:3] = env.actions.number_of(goal[6, :2] + beside_m)

    def shown(shift_m: float, *, success: bool) -> Demonstration:
        seen = np.stack([nodes + np.float32(shift_m), nodes])
        return Demonstration(
            observations={"nodes": seen, "goal": np.stack([goal, goal])},
            actions=vector[None],
            rewards=np.ones(1),
            rmse_m=np.zeros(2),
            success=success,
            seed=0,
        )

    policy = example["NearestDemonstration"]([shown(0.0, success=True), shown(0.1, success=False)], env)
    elsewhere = np.array([0.03, 0.02, 0.0], dtype=np.float32)
    (proposed,) = policy({"nodes": nodes + elsewhere, "goal": goal + elsewhere})
    assert proposed[0] == vector[0]
    released = env.actions.number_of(goal[6, :2] + elsewhere[:2] + beside_m)
    np.testing.assert_allclose(proposed[1:3], released, atol=1e-6)
    with pytest.raises(InputError, match="no demonstration succeeded"):
        example["NearestDemonstration"]([shown(0.0, success=False)], env)
