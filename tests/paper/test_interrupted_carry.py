"""A carry that a lost lease interrupts goes on: the DLO stays in the fingers, and its ends are not exchanged."""

import asyncio
from pathlib import Path

import pytest

from dlokit.communication.component import Component
from dlokit.decision.config import TaskConfig
from dlokit.evaluation.evaluator import evaluate, read_truth
from dlokit.extras.bench.shaping.metrics import FALSE_MARGIN_M
from dlokit.functional.cell.config import CellConfig
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.robot.component import RobotComponent
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import run_lockstep
from dlokit.system.shaping import Watcher
from dlokit.types.flow import FlowStatus, RunOutcome
from dlokit.types.robot import RobotReason

RUN = RunConfig(
    headless=True,
    record=False,
    start="S",
    goal="I",
    task=TaskConfig(check_camera=False),
    cell=CellConfig(settle_s=0.5),
    planning=PlanningConfig(strategy=RolloutConfig(search=SearchConfig(rollouts=160, finalists=2))),
)
"""It begins with the first look, and a third of the usual rollouts finds the lay-down."""
INTO_CARRY_S = 2.5
"""The rope then hangs in the air, folded in two: released there, it lies so that its ends cannot be told apart."""


class LateCommander(Watcher):
    """Lets the arm's lease expire once, in the middle of the first carry."""

    def __init__(self) -> None:
        self._arm: RobotComponent | None = None
        self._losing: asyncio.Task[None] | None = None

    def build(self, name: str, config: RunConfig, wiring: Wiring) -> Component:
        component = build_component(name, config, wiring)
        if isinstance(component, RobotComponent):
            self._arm = component
        return component

    def step(self, status: FlowStatus) -> None:
        if status.step == "move_to_goal" and self._losing is None:
            self._losing = asyncio.create_task(self._lose_lease())

    async def _lose_lease(self) -> None:
        assert self._arm is not None
        await asyncio.sleep(INTO_CARRY_S)
        await self._arm.renew_lease("late", 0.05)
        await asyncio.sleep(0.2)
        await self._arm.release_lease("late")


@pytest.mark.heavy
def test_an_interrupted_lay_down_is_completed_in_the_same_action_and_converges_truly(tmp_path: Path) -> None:
    late = LateCommander()
    record = run_lockstep(RUN, job_from_config(RUN), tmp_path, late, late.build)
    assert [(one.action, one.reason) for one in record.result.recoveries] == [(1, RobotReason.LEASE_LOST)]
    assert record.result.history[0].ended_by is None
    assert record.result.outcome is RunOutcome.CONVERGED
    true_m = evaluate(record, read_truth(tmp_path)).final_m
    assert true_m is not None
    assert true_m < record.result.threshold_m + FALSE_MARGIN_M
