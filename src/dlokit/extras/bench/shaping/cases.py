"""Cases: an experiment with one seed and one method; and their results."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from dlokit.extras.bench.shaping.experiments import Experiment
from dlokit.skills.observer.config import OBSERVERS
from dlokit.skills.planning.config import PLANNERS
from dlokit.system.config import RunConfig
from dlokit.system.results.run_result import RunResult
from dlokit.types.arrays import Float64Array

IDEAL = "ideal"
"""Name in place of the observer in a run whose state is the cell's ground truth."""


@dataclass(frozen=True, kw_only=True)
class ShapingMethod:
    """A combination of observer and planner, by the names of the strategies."""

    observer: str
    planner: str
    blind: bool = False
    """Whether the planner does not know of the fixtures; the arm still keeps clear of them."""

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.planner}, {self.observer}" + (", blind" if self.blind else "")

    @property
    def sees_truth(self) -> bool:
        """Whether the state is the cell's ground truth."""
        return self.observer == IDEAL


def methods_of(
    config: RunConfig, observers: Sequence[str], planners: Sequence[str], *, blind: bool = False
) -> tuple[ShapingMethod, ...]:
    """Every planner with every observer; by default those of the configuration. `blind`: also without the fixtures."""
    return tuple(
        ShapingMethod(observer=observer, planner=planner, blind=without)
        for planner in planners or (config.planning.strategy.name,)
        for observer in observers or (config.observer.strategy.name,)
        for without in ((False, True) if blind else (False,))
    )


def with_method(config: RunConfig, method: ShapingMethod) -> RunConfig:
    """The configuration with a method's strategies; unchanged ones keep their settings, changed ones get defaults.

    Raises `ConfigError` for an unknown name.
    """
    observer, planning = config.observer, config.planning
    if method.observer != observer.strategy.name and not method.sees_truth:
        observer = replace(observer, strategy=OBSERVERS.named(method.observer, "--observer")())
    if method.planner != planning.strategy.name:
        planning = replace(planning, strategy=PLANNERS.named(method.planner, "--planner")())
    # The ground truth needs no camera, so its pose is not checked.
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
        """The seed of the run itself, the same for every method."""
        return self.seed + self.experiment.seed_offset

    @property
    def folder_name(self) -> str:
        """Name of its folder in the folder of the sweep."""
        method = self.method
        parts = (self.experiment.name, str(self.seed), method.planner, method.observer, *["blind"] * method.blind)
        return "-".join(re.sub(r"[^A-Za-z0-9._]+", "-", part).strip("-.") for part in parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseShapes:
    """The shapes in a picture of a case, all in the world frame [m].

    Start and end are the ground truth; without a cell, the estimates of the system under test.
    """

    start_world: Float64Array  # (Mc, 3) before the first action
    goal_world: Float64Array  # (M, 3) the goal
    final_world: Float64Array  # (Mc, 3) at the end


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseResult:
    """The result of a case."""

    case: ShapingCase
    result: RunResult
    shapes: CaseShapes | None = None
    """None if the run failed with an error, or, without a cell, never saw the DLO."""
    fault: str | None = None
    """The error of a failed run, which is repeated when the sweep is resumed."""


def judged_by_truth(results: Sequence[CaseResult]) -> bool:
    """Whether the ground truth judges these cases; False: the system under test judges itself."""
    runs = [done.result for done in results]
    return any(run.true_rmse_m is not None for run in runs) or all(run.rmse_m is None for run in runs)


OWN_ESTIMATE = "the system's own estimate (rmse_m): there is no ground truth without a simulated cell"
"""Description of the judge of cases without a truth."""


def cases(
    experiments: Sequence[Experiment], seeds: int, methods: Sequence[ShapingMethod], *, first_seed: int = 0
) -> Iterator[ShapingCase]:
    """Every experiment with every seed, with the same start for every method.

    Ordered by seed, so that an interrupted sweep covers every experiment.
    """
    for seed in range(first_seed, first_seed + seeds):
        for experiment in experiments:
            for method in methods:
                drawn = experiment.of_seed(seed + experiment.seed_offset)
                yield ShapingCase(experiment=drawn, seed=seed, method=method)
