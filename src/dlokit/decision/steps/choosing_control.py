"""Planning alone, or control after it: chosen for every action before the arm moves."""

import math
from collections.abc import Sequence

import numpy as np

from dlokit.decision.task import ActionRecord, ShapeTask
from dlokit.geometry import rmse_m
from dlokit.skills.planning import api as planning
from dlokit.types.action import Action, kind_of
from dlokit.types.outcome import Succeeded

NOT_WORTH_IT = "not_worth_it"
"""The word of an action that control does not follow."""


async def choose_control(task: ShapeTask, action: Action) -> None:
    """Whether control follows the action that was proposed for the present shape."""
    task.corrections, task.corrections_seen, task.control_end, task.controlled = [], [], "", False
    if not task.config.control:
        return
    assert task.state is not None
    assert task.goal is not None
    missed = missed_m(task.history, kind_of(action))
    asked = await task.port.call(planning.FORESEE_CONTROL, task.state, task.goal, action, missed)
    task.controlled = isinstance(asked, Succeeded) and asked.result.follows
    task.control_end = "" if task.controlled else NOT_WORTH_IT


def missed_m(history: Sequence[ActionRecord], kind: str) -> float:
    """How far actions of a kind ended from what was predicted (RMS) [m]; 0 before the first.

    Those that missed the DLO, lost it, ended early, or were corrected on the way tell nothing.
    """
    squares = [
        rmse_m(done.nodes_world, done.expected_world) ** 2
        for done in history
        if done.kind == kind and done.expected_world is not None and _as_planned(done)
    ]
    return math.sqrt(float(np.mean(squares))) if squares else 0.0


def _as_planned(done: ActionRecord) -> bool:
    return done.grasp_ok and not done.slipped and not done.ended_by and not done.corrections
