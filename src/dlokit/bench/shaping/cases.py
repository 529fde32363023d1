"""Cases: an experiment with one seed, by one method; and what came of them."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dlokit.bench.shaping.experiments import Experiment
from dlokit.bench.shaping.methods import Method
from dlokit.system.results.run_result import RunResult
from dlokit.types.arrays import Float64Array


@dataclass(frozen=True, kw_only=True)
class Case:
    """One experiment with one seed, by one method."""

    experiment: Experiment
    seed: int
    method: Method

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

    case: Case
    result: RunResult
    shapes: CaseShapes | None = None
    """None where the run broke down."""
    fault: str | None = None
    """What broke the run down; it is run again when the sweep is resumed."""


def cases(
    experiments: Sequence[Experiment], seeds: int, methods: Sequence[Method], *, first_seed: int = 0
) -> Iterator[Case]:
    """Every experiment with every seed, from the same start by every method.

    Seed by seed, so that what is done before an end by Ctrl-C has every experiment in it.
    """
    for seed in range(first_seed, first_seed + seeds):
        for experiment in experiments:
            for method in methods:
                yield Case(experiment=experiment, seed=seed, method=method)
