"""`dlokit bench shaping`: the paper's five experiments, each over several seeds, judged by the hidden truth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dlokit.bench.judged_run import judged_run
from dlokit.decision.task import GoalRequest
from dlokit.description import shapes
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.system.config import RunConfig
from dlokit.system.run_result import ActionResult, RunResult
from dlokit.system.shaping import ShapeJob
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import FlowStatus

MOVED_BY_M = (0.06, 0.1375)
"""The goal of I to I lies 15 cm from the start, in the direction that keeps all of it in reach."""
TURNED_BY_RAD = np.deg2rad(40.0)
_CURVE_POINTS = 101


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One of the paper's experiments."""

    name: str
    start: str
    goal: str


PAPER_SUITE: tuple[Experiment, ...] = (
    Experiment(name="I to S", start="I", goal="S"),
    Experiment(name="S to I", start="S", goal="I"),
    Experiment(name="I to I", start="I", goal="I moved"),
    Experiment(name="random to I", start="random", goal="I"),
    Experiment(name="random to S", start="random", goal="S"),
)
"""Section 5.3: Fig. 7a (I to I), Fig. 7b (random to S), Fig. 8."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """Who sees and who chooses, by the names of the strategies."""

    observer: str
    planner: str

    @property
    def name(self) -> str:
        """As tables call it."""
        return f"{self.planner}, {self.observer}"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One experiment with one seed, by one method."""

    experiment: Experiment
    seed: int
    method: Method


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """What became of it."""

    case: Case
    result: RunResult


class _Silent:
    def step(self, status: FlowStatus) -> None:
        pass

    def action(self, row: ActionResult) -> None:
        pass


def methods_of(config: RunConfig, observers: Sequence[str], planners: Sequence[str]) -> tuple[Method, ...]:
    """Every planner with every observer; where none is named, the configuration's."""
    return tuple(
        Method(observer=observer, planner=planner)
        for planner in planners or (config.planning.strategy.name,)
        for observer in observers or (config.observer.strategy.name,)
    )


def with_method(config: RunConfig, method: Method) -> RunConfig:
    """The configuration with a method's strategies, those that it had with their settings, others with their defaults.

    Raises `ConfigError` for a name that is not known.
    """
    observer, planning = config.observer, config.planning
    if method.observer != observer.strategy.name:
        observer = replace(observer, strategy=OBSERVERS.named(method.observer, "--observer")())
    if method.planner != planning.strategy.name:
        planning = replace(planning, strategy=PLANNERS.named(method.planner, "--planner")())
    return replace(config, observer=observer, planning=planning)


def cases(suite: Sequence[Experiment], seeds: int, methods: Sequence[Method], *, first_seed: int = 0) -> Iterator[Case]:
    """Every experiment with every seed, from the same start by every method."""
    for experiment in suite:
        for seed in range(first_seed, first_seed + seeds):
            for method in methods:
                yield Case(experiment=experiment, seed=seed, method=method)


def run_case(case: Case, config: RunConfig, folder: Path) -> CaseResult:
    """Run one case in lockstep; its files are left in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    record = judged_run(config, job_of(case, config), folder, _Silent())
    return CaseResult(case=case, result=record.result)


def job_of(case: Case, config: RunConfig) -> ShapeJob:
    """The curves of a case: the start for the cell's DLO, the goal for the system's model of it."""
    dlo, model = config.cell.dlo, config.model
    start = _shape(case.experiment.start, case.seed, dlo.length_m, dlo.radius_m)
    goal = _shape(case.experiment.goal, case.seed, model.length_m, model.radius_m)
    return ShapeJob(
        name=case.experiment.name,
        start_nodes_world=start,
        request=GoalRequest(nodes_world=goal, name=case.experiment.goal),
    )


def _shape(name: str, seed: int, length_m: float, radius_m: float) -> Float64Array:
    if name == "random":
        # The same stream as `dlokit shape --start random --seed K`, so that a case can be run again by hand.
        return shapes.random_shape(np.random.default_rng([seed, 0]), length_m, _CURVE_POINTS, radius_m=radius_m)
    if name == "I moved":
        straight = shapes.builtin_shape("I", length_m, _CURVE_POINTS, radius_m=radius_m)
        return shapes.moved(straight, MOVED_BY_M, TURNED_BY_RAD)
    return shapes.builtin_shape(name, length_m, _CURVE_POINTS, radius_m=radius_m)
