"""Planning alone, or control after it: chosen for every action before the arm moves."""

import math

import numpy as np

from dlokit.decision.task import ShapeTask
from dlokit.geometry import rmse_m
from dlokit.skills.planning import api as planning
from dlokit.types.action import Action, kind_of
from dlokit.types.outcome import Succeeded


async def choose_control(task: ShapeTask, action: Action) -> None:
    """Whether control follows the action that was proposed for the present shape."""
    task.corrections, task.corrections_seen, task.control_end, task.controlled = [], [], "", False
    if not task.config.control:
        return
    assert task.state is not None
    assert task.goal is not None
    asked = await task.port.call(planning.FORESEE_CONTROL, task.state, task.goal, action, _missed_m(task, action))
    task.controlled = isinstance(asked, Succeeded) and asked.result.follows
    task.control_end = "" if task.controlled else "not_worth_it"


def _missed_m(task: ShapeTask, action: Action) -> float:
    """What actions of that kind ended from what was predicted, in this task (RMS) [m]; 0 before the first."""
    squares = [
        rmse_m(done.nodes_world, done.expected_world) ** 2
        for done in task.history
        if done.kind == kind_of(action) and done.expected_world is not None and done.grasp_ok and not done.corrections
    ]
    return math.sqrt(float(np.mean(squares))) if squares else 0.0
