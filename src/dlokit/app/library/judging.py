"""`dlokit.judge`: whether a goal can be reached and will hold, without a robot and a camera."""

from __future__ import annotations  # or `help` spells out every member of `ArrayLike`

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from dlokit.app.library.loops import outside_any_loop
from dlokit.communication.timing import virtual_time
from dlokit.errors import require_cell
from dlokit.geometry import resample
from dlokit.skills.planning import api as planning
from dlokit.system.build import Wiring, assemble
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config, named_or_saved
from dlokit.system.request import Choices, RunRequest
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict


def judge(
    goal: str | Path | ArrayLike = "S",
    *,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    **choices: Unpack[Choices],
) -> GoalVerdict:
    """Try a goal in the model: does the arm reach it, and does the DLO stay there when it is released?

    `goal` is ``"I"``, ``"S"``, ``"random"`` (drawn from `seed`), a file, or points (K, 2) or (K, 3) [m] in the world
    frame. `choices` (``dlo``, ``installation``, …) and `settings` are those of `shape`; what is configured of the DLO
    is what the verdict is about. The camera's view is not judged: no picture was taken. The verdict's `standing` is
    ``HOLDS``, ``DOUBTFUL`` or ``INFEASIBLE``, `text` says why, and `nearest_world` is the nearest shape that holds.

    Raises `InputError` where the goal or a setting cannot work.
    """
    require_cell("dlokit.judge")
    with tempfile.TemporaryDirectory() as folder:
        config = RunRequest(choices=choices, settings={"seed": seed, **(settings or {})}).configured()
        config = replace(config, goal=named_or_saved(goal, "goal", Path(folder)), headless=True)
        # A goal off the table is judged like any other.
        job = job_from_config(replace(config, task=replace(config.task, infeasible="try")))
        assert job.request is not None
        nodes = resample(np.asarray(job.request.nodes_world), config.model.nodes)
        shape = GoalShape(
            stamp_ns=0, nodes_world=nodes, name=config.goal, ends_interchangeable=config.ends_interchangeable
        )
        # A judgement takes about a second: Ctrl-C waits for it.
        return outside_any_loop(lambda: virtual_time.run(_judged(config, shape)), lambda: None)


async def _judged(config: RunConfig, goal: GoalShape) -> GoalVerdict:
    async with assemble(["planning"], config, Wiring()) as host:
        outcome = await host.transport.call(planning.JUDGE_GOAL, goal, config.task.threshold_m)
    return outcome.unwrap("the goal was not judged")
