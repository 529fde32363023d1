"""What every action strategy keeps to; a new one is a row in `strategies.OURS`."""

import asyncio
from collections.abc import Callable

import numpy as np
import pytest

from dlokit import geometry
from dlokit.communication.wire import codec
from dlokit.description.shapes import builtin_shape, moved, random_shape
from dlokit.errors import SkillRejected
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.nodes import topology
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools, StrategyConfig
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.planning.strategies import OURS, from_spec, to_spec
from dlokit.types.action import Action, Drag, Marks, Push
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose
from dlokit.types.system import StrategySpec

MODEL = BelievedDlo()
STARTS = {
    "I": builtin_shape("I", MODEL.length_m, MODEL.nodes),
    "moved": moved(builtin_shape("I", MODEL.length_m, MODEL.nodes), (0.05, 0.05), 0.7),
    "random": random_shape(np.random.default_rng(3), MODEL.length_m, MODEL.nodes),
}
SHORT = RolloutConfig(search=SearchConfig(rollouts=40, finalists=2, generations=1))
"""What holds of every action needs no long search."""
GOAL = GoalShape(stamp_ns=0, nodes_world=builtin_shape("S", MODEL.length_m, MODEL.nodes))

pytestmark = pytest.mark.parametrize("config", OURS, ids=lambda config: config.name)


def everywhere(T: Pose) -> bool:
    return True


def proposals(
    config: type[StrategyConfig],
    start: str,
    marked: tuple[int, ...] = (),
    reachable: Callable[[Pose], bool] = everywhere,
) -> list[Action]:
    settings = SHORT if config is RolloutConfig else config()
    strategy = settings.build(PlanningTools(reachable=reachable, actions=ActionConfig(), model=MODEL))
    shape = DloState(stamp_ns=5, nodes_world=STARTS[start], topology=topology(MODEL))
    marks = Marks(invalid_nodes=np.array(marked, dtype=np.int64))

    async def collect() -> list[Action]:
        return [action async for action in strategy.propose(shape, GOAL, marks)]

    return asyncio.run(collect())


def yaw_rad(T: Pose) -> float:
    R = geometry.rotation(T)
    return float(np.arctan2(R[1, 0], R[0, 0]))


def wrapped(angles_rad: Float64Array) -> Float64Array:
    return (angles_rad + np.pi) % (2.0 * np.pi) - np.pi


@pytest.mark.parametrize("start", list(STARTS))
def test_every_action_can_be_executed_as_it_stands(config: type[StrategyConfig], start: str) -> None:
    actions = proposals(config, start)
    assert actions
    for action in actions:
        assert 0 <= action.grasp.node < MODEL.nodes
        distance = np.linalg.norm(action.grasp.T_world_tcp.position_m[:2] - STARTS[start][action.grasp.node, :2])
        if isinstance(action, Push):
            assert action.grasp.opening_m == 0.0
            assert 0.015 < distance < 0.12  # beside the rod, on nothing
        else:
            assert 0.0 < action.grasp.opening_m <= 0.08  # what the hand can open
            # The grasp is on the rod, at most the inset from an end and half a segment off its node.
            assert distance < 0.02
        yaws = [yaw_rad(pose) for pose in (action.grasp.T_world_tcp, *action.path)]
        # Further apart, the arm could turn the short way round where the long one is meant.
        assert np.abs(wrapped(np.diff(yaws))).max() < 0.5
        for pose in (action.grasp.T_world_tcp, *action.path):
            assert geometry.rotation(pose)[2, 2] == pytest.approx(-1.0)
        assert action.path[-1].position_m[2] == pytest.approx(action.grasp.T_world_tcp.position_m[2])
        lifted_m = max(pose.position_m[2] for pose in action.path) - action.path[-1].position_m[2]
        assert lifted_m < 0.01 if isinstance(action, Drag | Push) else lifted_m > 0.019
        assert min(action.velocity.speed_m_s, action.velocity.acceleration_m_s2, action.velocity.jerk_m_s3) > 0.0


def test_no_marked_node_is_proposed(config: type[StrategyConfig]) -> None:
    first = proposals(config, "I")[0].grasp.node
    assert first not in {action.grasp.node for action in proposals(config, "I", (first,))}


def test_with_every_node_marked_there_is_nothing_to_do(config: type[StrategyConfig]) -> None:
    assert proposals(config, "I", tuple(range(MODEL.nodes))) == []


def test_every_pose_at_which_the_tool_stops_is_reachable(config: type[StrategyConfig]) -> None:
    def near(T: Pose) -> bool:
        return bool(T.position_m[1] < 0.1)

    for action in proposals(config, "I", reachable=near):
        assert near(action.grasp.T_world_tcp)
        assert near(action.path[-1])


def test_the_same_question_has_the_same_answer(config: type[StrategyConfig]) -> None:
    first, second = proposals(config, "random"), proposals(config, "random")
    assert [codec.encode(action) for action in first] == [codec.encode(action) for action in second]


def test_its_settings_travel(config: type[StrategyConfig]) -> None:
    assert from_spec(to_spec(config())) == config()
    assert from_spec(StrategySpec(name=config.name)) == config()


def test_a_setting_that_it_does_not_have_is_rejected_by_name(config: type[StrategyConfig]) -> None:
    with pytest.raises(SkillRejected, match=r"no setting.*colour") as rejected:
        from_spec(StrategySpec(name=config.name, settings=b'{"colour": 1}'))
    assert rejected.value.reason == "bad_settings"
