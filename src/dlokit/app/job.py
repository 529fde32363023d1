"""From what the user typed to what a run does."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dlokit.app.shape_input import is_file_name, shape_from_text
from dlokit.decision.task import GoalRequest
from dlokit.system.config import INTERACTIVE, RunConfig
from dlokit.system.shaping import ShapeJob
from dlokit.types.arrays import Float64Array

_CURVE_POINTS = 101  # start and goal are kept finer than either rod and resampled by each


def job_from_config(config: RunConfig) -> ShapeJob:
    """Read, draw or look up start and goal. Raises `ShapeError`.

    The start is as long as the cell's DLO, the goal as long as the system believes it to be.
    """
    start = _shape(config, config.start, config.cell.dlo.length_m, config.cell.dlo.radius_m, stream=0)
    name = f"{Path(config.start).name} to {Path(config.goal).name}"
    if config.goal == INTERACTIVE:
        return ShapeJob(name=name, start_nodes_world=start, request=None)
    model = config.model
    goal = _shape(
        config,
        config.goal,
        model.length_m,
        model.radius_m,
        stream=1,
        middle_m=config.goal_at_m,
        # A goal off the table is refused at once, unless it shall be moved, or tried where it is.
        on_table=config.task.infeasible == "reject",
    )
    request = GoalRequest(nodes_world=goal, name=config.goal, ends_interchangeable=config.ends_interchangeable)
    return ShapeJob(name=name, start_nodes_world=start, request=request)


def with_absolute_files(config: RunConfig) -> RunConfig:
    """Files by their absolute paths, so that the configuration of the run holds in every folder."""
    hosts = config.hosts
    if hosts is not None and hosts.certificates:
        hosts = replace(hosts, certificates=str(hosts.folder.absolute()))
    return replace(config, start=_absolute(config.start), goal=_absolute(config.goal), hosts=hosts)


def _absolute(text: str) -> str:
    return str(Path(text).expanduser().absolute()) if is_file_name(text) else text


def _shape(
    config: RunConfig,
    text: str,
    length_m: float,
    radius_m: float,
    *,
    stream: int,
    middle_m: tuple[float, float] | None = None,
    on_table: bool = True,
) -> Float64Array:
    # Start and goal draw from streams of their own, so that one does not change the other.
    rng = np.random.default_rng([config.seed, stream])
    return shape_from_text(
        text,
        length_m=length_m,
        count=_CURVE_POINTS,
        radius_m=radius_m,
        rng=rng,
        fit_length=config.fit_length,
        middle_m=middle_m,
        on_table=on_table,
    )
