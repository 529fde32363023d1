"""From what the user typed to what a run does."""

import numpy as np

from dlokit.app.shape_input import shape_from_text
from dlokit.decision.task import GoalRequest
from dlokit.system.config import RunConfig
from dlokit.system.shaping import ShapeJob
from dlokit.types.arrays import Float64Array

INTERACTIVE = "interactive"
"""The goal that the operator drags in the viewer."""
_CURVE_POINTS = 101  # start and goal are kept finer than either rod and resampled by each


def job_from_config(config: RunConfig) -> ShapeJob:
    """Read, draw or look up start and goal. Raises `ShapeError`.

    The start is as long as the cell's DLO, the goal as long as the system believes it to be.
    """
    start = _shape(config, config.start, config.cell.dlo.length_m, config.cell.dlo.radius_m, stream=0)
    name = f"{config.start} to {config.goal}"
    if config.goal == INTERACTIVE:
        return ShapeJob(name=name, start_nodes_world=start, request=None)
    goal = _shape(config, config.goal, config.model.length_m, config.model.radius_m, stream=1)
    request = GoalRequest(nodes_world=goal, name=config.goal, ends_interchangeable=config.ends_interchangeable)
    return ShapeJob(name=name, start_nodes_world=start, request=request)


def _shape(config: RunConfig, text: str, length_m: float, radius_m: float, *, stream: int) -> Float64Array:
    # Start and goal draw from streams of their own, so that one does not change the other.
    rng = np.random.default_rng([config.seed, stream])
    return shape_from_text(
        text, length_m=length_m, count=_CURVE_POINTS, radius_m=radius_m, rng=rng, fit_length=config.fit_length
    )
