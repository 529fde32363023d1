"""Compilation before the first decision covers everything that a decision needs."""

import asyncio
import pickle
from typing import Any

import numpy as np
from model_bench import robot_at

from dlokit.description.shapes import builtin_shape
from dlokit.motion import tool_track
from dlokit.rod import planning_rod
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.skills.model.carry import Carry
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import Loaded, PlanningTools
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.types.action import Marks
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.robot import FIRST_ROBOT

MODEL = BelievedDlo()
SHORT = RolloutConfig(search=SearchConfig(rollouts=40, finalists=2, generations=1))


def compiled() -> dict[str, int]:
    """Number of compiled versions of each kernel, one for each combination of argument types."""
    kernels: dict[str, Any] = {**vars(planning_rod), **vars(tool_track)}
    return {name: len(kernel.signatures) for name, kernel in kernels.items() if hasattr(kernel, "signatures")}


def test_after_loading_a_decision_compiles_nothing() -> None:
    SHORT.load()
    before = compiled()
    assert before["simulate_motion"] == before["tool_track"] == 1
    shape = DloState(stamp_ns=0, nodes_world=builtin_shape("I", MODEL.length_m, MODEL.nodes), topology=topology(MODEL))
    goal = GoalShape(stamp_ns=0, nodes_world=builtin_shape("S", MODEL.length_m, MODEL.nodes))
    strategy = SHORT.build(PlanningTools(reachable=lambda T: True, actions=ActionConfig(), model=MODEL))

    async def decide() -> None:
        assert await anext(aiter(strategy.propose(shape, goal, Marks(invalid_nodes=np.zeros(0, dtype=np.int64)))))

    asyncio.run(decide())
    assert compiled() == before


def test_a_model_that_was_built_compiles_nothing_while_an_arm_carries() -> None:
    carry = Carry(MODEL)
    before = compiled()
    rod = builtin_shape("I", MODEL.length_m, MODEL.nodes)
    carry.place(rod)
    carry.take_hold(FIRST_ROBOT, 15, robot_at(rod[15], 0))
    assert carry.move(robot_at(rod[15] + 0.01, 20_000_000))
    assert carry.release(FIRST_ROBOT)
    assert compiled() == before


def test_loading_can_run_in_the_worker_process() -> None:
    assert isinstance(SHORT, Loaded)
    assert pickle.loads(pickle.dumps(SHORT.load))() > 0.0
