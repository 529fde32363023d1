"""Cases: an experiment with one seed, by one method that sees and chooses; and what came of them."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from dlokit.bench.shaping.experiments import Experiment
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.system.config import RunConfig
from dlokit.system.results.run_result import RunResult
from dlokit.types.arrays import Float64Array

IDEAL = "ideal"
"""The observer's place in a run whose state is taken from the cell's truth."""


@dataclass(frozen=True, kw_only=True)
class ShapingMethod:
    """Who sees and who chooses, by the names of the strategies."""

    observer: str
    planner: str

    @property
    def name(self) -> str:
        """As tables call it."""
        return f"{self.planner}, {self.observer}"

    @property
    def sees_truth(self) -> bool:
        """Whether the state is the cell's truth."""
        return self.observer == IDEAL


def methods_of(config: RunConfig, observers: Sequence[str], planners: Sequence[str]) -> tuple[ShapingMethod, ...]:
    """Every planner with every observer; where none is named, the configuration's."""
    return tuple(
        ShapingMethod(observer=observer, planner=planner)
        for planner in planners or (config.planning.strategy.name,)
        for observer in observers or (config.observer.strategy.name,)
    )


def with_method(config: RunConfig, method: ShapingMethod) -> RunConfig:
    """The configuration with a method's strategies, those that it had with their settings, others with their defaults.

    Raises `ConfigError` for a name that is not known.
    """
    observer, planning = config.observer, config.planning
    if method.observer != observer.strategy.name and not method.sees_truth:
        observer = replace(observer, strategy=OBSERVERS.named(method.observer, "--observer")())
    if method.planner != planning.strategy.name:
        planning = replace(planning, strategy=PLANNERS.named(method.planner, "--planner")())
    # The truth needs no camera, whose place could be checked.
    task = replace(config.task, check_camera=config.task.check_camera and not method.sees_truth)
    return replace(config, observer=observer, planning=planning, task=task)


@dataclass(frozen=True, kw_only=True)
class ShapingCase:
    """One experiment with one seed, by one method."""

    experiment: Experiment
    seed: int
    method: ShapingMethod

    @property
    def run_seed(self) -> int:
        """The seed of the run itself: the same for every method."""
        return self.seed + self.experiment.seed_offset

    @property
    def folder_name(self) -> str:
        """Where its files lie, in the folder of the sweep."""
        parts = (self.experiment.name, str(self.seed), self.method.planner, self.method.observer)
        return "-".join(re.sub(r"[^A-Za-z0-9._]+", "-", part).strip("-.") for part in parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseShapes:
    """What a picture of a case shows, all in the world frame [m]."""

    start_world: Float64Array  # (Mc, 3) the truth before the first action
    goal_world: Float64Array  # (M, 3) what was aimed at
    final_world: Float64Array  # (Mc, 3) the truth at the end


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseResult:
    """What became of it."""

    case: ShapingCase
    result: RunResult
    shapes: CaseShapes | None = None
    """None where the run broke down."""
    fault: str | None = None
    """What broke the run down; it is run again when the sweep is resumed."""


def cases(
    experiments: Sequence[Experiment], seeds: int, methods: Sequence[ShapingMethod], *, first_seed: int = 0
) -> Iterator[ShapingCase]:
    """Every experiment with every seed, from the same start by every method.

    Seed by seed, so that what is done before an end by Ctrl-C has every experiment in it.
    """
    for seed in range(first_seed, first_seed + seeds):
        for experiment in experiments:
            for method in methods:
                yield ShapingCase(experiment=experiment, seed=seed, method=method)
