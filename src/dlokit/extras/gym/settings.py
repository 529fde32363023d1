"""Arguments of the environments as the configuration of their episodes."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from dlokit.app.library.settings import named_or_saved, with_settings
from dlokit.app.shape.inputs import RANDOM
from dlokit.app.shape.job import NamedChoices, job_from_config, with_choices
from dlokit.app.shape.preflight import require_one_world
from dlokit.errors import ConfigError
from dlokit.functional.cell.config import EVERY_FACTOR, Factor
from dlokit.skills.planning.base import StrategyConfig
from dlokit.system.config import RunConfig
from dlokit.system.shaping import ShapeJob

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
    *,
    dlo: str | None = None,
    physics: str | None = None,
    randomised: bool | Sequence[Factor] = False,
    installation: Path | str | None = None,
    camera: str | None = None,
    observer: str | None = None,
    planner: str | StrategyConfig | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Episodes:
    """The episodes that the arguments of an environment describe; the names are those of `dlokit.shape`.

    Raises `ConfigError` for an argument that cannot work.
    """
    choices = NamedChoices(
        dlo=dlo,
        physics=physics,
        installation=installation,
        camera=camera,
        observer=observer,
        planner=planner if isinstance(planner, str) else None,
    )
    run = with_settings(with_choices(RunConfig(), choices), settings or {})
    factors = EVERY_FACTOR if randomised is True else tuple(randomised or ())
    if unknown := sorted(set(factors) - set(EVERY_FACTOR)):
        raise ConfigError(f"randomised has {', '.join(unknown)}; allowed are {', '.join(EVERY_FACTOR)}.")
    run = replace(
        run,
        runtime="lockstep",
        headless=True,
        record=False,
        cell=replace(run.cell, randomised=factors or run.cell.randomised),
        # Success or the budget of steps ends an episode; no goal is refused.
        task=replace(run.task, infeasible="try"),
    )
    if planner is not None and not isinstance(planner, str):
        run = replace(run, planning=replace(run.planning, strategy=planner))
    if run.arms != 1:
        raise ConfigError("an environment moves one arm; omit the setting arms.")
    if not run.has_cell:
        raise ConfigError(f"an environment is a simulated cell, which camera {run.camera.name} does not see.")
    require_one_world(run)
    return Episodes(config=run, start=start, goal=goal)
