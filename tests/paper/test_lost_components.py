"""A component needed for observation is lost for a while: the task waits, finds the rope again, and continues."""

import asyncio
import math
from typing import ParamSpec, TypeVar

import numpy as np
import pytest
from ideal_lab import LENGTH_M, NODES, Lab, Trace, shape

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.transport import Liveness
from dlokit.decision.config import TaskConfig
from dlokit.description.shapes import builtin_shape
from dlokit.types.flow import FlowStatus, GoalFrame, GoalFrames, RunOutcome
from dlokit.types.outcome import Outcome, Unreachable

P = ParamSpec("P")
R = TypeVar("R")

I = builtin_shape("I", LENGTH_M, NODES)  # noqa: E741  the shape's name
GOAL = I + np.array([0.05, 0.0, 0.0])
FRAMES = GoalFrames(
    stamp_ns=0, frames=tuple(GoalFrame(node=node, x_m=0.55, y_m=y_m) for node, y_m in ((0, -0.25), (NODES - 1, 0.25)))
)
AWAY_S = 12.0


class LosingTransport(MemoryTransport):
    """A component stops answering for a while, each time from one call on."""

    def __init__(self, component: str, *calls: int, away_s: float = AWAY_S) -> None:
        super().__init__()
        self._component = component
        self._calls = list(calls)
        self._away_s = away_s
        self._back_s = -math.inf
        self._count = 0
        self._losses = 0

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        if skill.component == self._component:
            self._count += 1
            if self._count in self._calls:
                self._losses += 1
                self._back_s = asyncio.get_running_loop().time() + self._away_s
            if self._gone:
                return Unreachable(component=skill.component)
        return await super().call(skill, *args, **kwargs)

    def alive(self, component: str) -> Liveness:
        if component != self._component:
            return Liveness(super().alive(component).alive, f"the process of {component}")
        return Liveness(False) if self._gone else Liveness(True, f"process {self._losses} of {component}")

    @property
    def _gone(self) -> bool:
        return asyncio.get_running_loop().time() < self._back_s


def with_loss(component: str, *calls: int, away_s: float = AWAY_S, config: TaskConfig | None = None) -> Trace:
    lab = Lab(nodes=I.copy())
    return shape(lab, GOAL, config, bus=lambda: LosingTransport(component, *calls, away_s=away_s))


@pytest.mark.parametrize(
    ("component", "call", "box"),
    [
        ("perception", 1, "find_dlo"),
        ("observer", 1, "find_dlo"),
        ("model", 1, "set_goal"),
        ("perception", 2, "track_model"),
    ],
)
def test_a_component_lost_before_the_first_action_is_awaited_and_the_task_restarts(
    component: str, call: int, box: str
) -> None:
    trace = with_loss(component, call)
    assert (box, "lost", "restore") in trace.edges()
    assert ("restore", "begin", "check_camera") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_a_camera_lost_after_an_action_is_awaited_and_the_action_counts_once() -> None:
    looks_before_the_first_action = 3
    tracking_on_and_off = 2
    trace = with_loss("perception", looks_before_the_first_action + tracking_on_and_off + 1)
    assert ("track_again", "lost", "restore") in trace.edges()
    assert ("restore", "look_again", "track_again") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.calls.count("follow_path") == len(trace.result.history)


@pytest.mark.parametrize(("component", "calls_before", "checks"), [("observer", 2, 1), ("perception", 9, 2)])
def test_the_camera_is_checked_again_only_if_perception_was_lost(
    component: str, calls_before: int, checks: int
) -> None:
    trace = shape(
        Lab(nodes=I.copy(), checks_camera=True), GOAL, bus=lambda: LosingTransport(component, calls_before + 1)
    )
    assert ("restore", "look_again", "track_again") in trace.edges()
    assert trace.calls.count("check_camera") == checks
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_a_component_lost_again_during_its_restoration_is_awaited_again() -> None:
    told_again, looks_then = 6, 8  # an observation in track_again; in restore, after tracking was switched off
    trace = with_loss("perception", told_again, looks_then)
    assert ("restore", "lost", "restore") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_a_component_that_is_lost_repeatedly_ends_the_task_by_name() -> None:
    trace = with_loss("perception", *range(1, 40))
    assert ("restore", "too_often", "failed") in trace.edges()
    assert trace.result.outcome is RunOutcome.FAILED
    assert trace.result.reason is not None
    assert "perception.look unreachable" in trace.result.reason


def test_a_component_that_does_not_return_ends_the_task_by_name() -> None:
    trace = with_loss("observer", 1, away_s=1e6)
    assert ("restore", "failed", "failed") in trace.edges()
    assert trace.result.reason is not None
    assert trace.result.reason.startswith("observer not restarted within 180 s")


def test_an_operator_who_has_set_the_goal_is_not_asked_again() -> None:
    pressed: list[FlowStatus] = []

    def operator(status: FlowStatus) -> GoalFrames | None:
        if status.step != "set_goal" or pressed:
            return None
        pressed.append(status)
        return FRAMES

    lab = Lab(nodes=I.copy())
    trace = shape(lab, None, operator=operator, bus=lambda: LosingTransport("perception", 2))
    assert ("restore", "begin", "check_camera") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED
