"""What the caller of `shape_dlo` asked for: a goal as a curve, and the settings of this one task."""

from dataclasses import replace

import numpy as np

from dlokit.decision.config import Infeasible, TaskConfig
from dlokit.decision.task import GoalRequest
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError, ShapeError, SkillRejected

_CURVE_POINTS = 101
"""Of a built-in shape; finer than the rod, which resamples it."""


def goal_request(goal: str | GoalRequest, *, length_m: float, radius_m: float) -> GoalRequest:
    """A built-in shape by its name, made for a DLO of that length and radius [m], or a curve as it is.

    Raises `SkillRejected` ``unknown_shape`` or ``bad_shape``.
    """
    if isinstance(goal, GoalRequest):
        return _checked(goal)
    try:
        nodes = builtin_shape(goal, length_m, _CURVE_POINTS, radius_m=radius_m)
    except ShapeError as error:
        raise SkillRejected("unknown_shape", str(error)) from error
    return GoalRequest(nodes_world=nodes, name=goal)


def _checked(goal: GoalRequest) -> GoalRequest:
    nodes = goal.nodes_world
    if nodes.ndim != 2 or nodes.shape[1] != 3 or len(nodes) < 2 or not np.isfinite(nodes).all():
        raise SkillRejected(
            "bad_shape", f"the goal has the shape {nodes.shape}; (K, 3) finite metres, K >= 2, are needed"
        )
    return goal


def adjusted(
    config: TaskConfig, threshold_m: float | None, max_actions: int | None, infeasible: Infeasible | None
) -> TaskConfig:
    """The settings of one task. Raises `SkillRejected` ``bad_settings``."""
    try:
        return replace(
            config,
            threshold_m=config.threshold_m if threshold_m is None else threshold_m,
            max_actions=config.max_actions if max_actions is None else max_actions,
            infeasible=config.infeasible if infeasible is None else infeasible,
        )
    except ConfigError as error:
        raise SkillRejected("bad_settings", str(error)) from error
