"""Arguments of the environments as the configuration of their episodes."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import require_one_world
from dlokit.system.job import RANDOM, ShapeJob, job_from_config, named_or_saved
from dlokit.system.request import Choices, RunRequest

_MOST_DRAWS, _FEW_DRAWS = 10, 3
Curve = str | Path | ArrayLike
"""A shape by its name, from a file, or as points (K, 2) or (K, 3) [m]; ``"random"`` is drawn from the seed."""


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """Common settings of all episodes of an environment."""

    config: RunConfig
    start: Curve
    goal: Curve

    def draws(self, options: Mapping[str, Any]) -> int:
        """Number of draws of an episode that cannot begin; small if only the camera's noise differs."""
        shapes = (options.get("start", self.start), options.get("goal", self.goal))
        drawn = any(isinstance(shape, str) and shape == RANDOM for shape in shapes)
        return _MOST_DRAWS if drawn else _FEW_DRAWS

    def job(self, seed: int, options: Mapping[str, Any]) -> tuple[RunConfig, ShapeJob]:
        """The configuration and the shapes of the episode with this seed.

        `options` may replace ``start`` and ``goal``. Raises `ConfigError` or `ShapeError`.
        """
        if unknown := sorted(set(options) - {"start", "goal"}):
            raise ConfigError(f"options of reset are start and goal, not {', '.join(unknown)}.")
        with tempfile.TemporaryDirectory() as folder:  # points are passed as a file, as everywhere
            run = replace(
                self.config,
                seed=seed,
                start=named_or_saved(options.get("start", self.start), "start", Path(folder)),
                goal=named_or_saved(options.get("goal", self.goal), "goal", Path(folder)),
            )
            return run, job_from_config(run)


def episodes_of(
    start: Curve,
    goal: Curve,
    settings: Mapping[str, Any] | None,
    choices: Choices,
) -> Episodes:
    """The episodes that the arguments of an environment describe; the names are those of `dlokit.shape`.

    Raises `ConfigError` for an argument that cannot work.
    """
    run = RunRequest(choices=choices, settings=settings or {}).configured()
    run = replace(
        run,
        runtime="lockstep",
        headless=True,
        record=False,
        # Success or the budget of steps ends an episode; no goal is refused.
        task=replace(run.task, infeasible="try"),
    )
    if run.arms != 1:
        raise ConfigError("an environment moves one arm; omit the setting arms.")
    if not run.has_cell:
        raise ConfigError(f"an environment is a simulated cell, which camera {run.camera.name} does not see.")
    require_one_world(run)
    return Episodes(config=run, start=start, goal=goal)
