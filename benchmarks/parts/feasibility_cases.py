"""A case: goals for one DLO in one drawn cell, judged at every level of knowledge, and released there."""

import asyncio
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.default_cameras import default_calibration
from dlokit.description.dlo import DloPreset, preset
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig, ElasticRod, ElastoplasticChain
from dlokit.functional.cell.world import Cell
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.config import PlanningConfig, load
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.skills.planning.verdict.feasibility import Workplace
from dlokit.skills.planning.verdict.goal_verdict import judge
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from parts.feasibility_beliefs import BENCH_DLOS, KnownDlo, Level, known
from parts.feasibility_releases import Happened, release
from parts.made_goals import made_goals, placed

DEFAULT_DLOS = ("soft_rope", "firm_rope", "stiff_rope", "silicone_hose", "wire_a", "wire_b")


@dataclass(frozen=True, kw_only=True)
class FeasibilityCase:
    """One DLO in one cell."""

    dlo: DloPreset
    seed: int
    threshold_m: float
    curves: Mapping[str, Float64Array]
    """Goals (K, 3) [m] by name; none: they are made up."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One goal, one DLO, one level of knowledge: what was said, and what happened."""

    dlo: str
    goal: str
    level: Level
    standing: Standing
    happened: Happened
    true_rmse_m: float
    """How far the cell's DLO sprang back [m]."""
    best_rmse_m: float
    """How near to the goal it came to rest at best [m]."""
    verdict_s: float
    """Processor time of the verdict [s]."""


def bench_dlo(name: str) -> DloPreset:
    """A DLO of the bench, or a preset, by its name. Raises ConfigError, listing the presets there are."""
    ours = {dlo.name: dlo for dlo in BENCH_DLOS}
    return ours.get(name.replace("-", "_")) or preset(name)


def judge_case(case: FeasibilityCase) -> list[Judged]:
    """Judge every goal of a case at every level, then release the cell's DLO there."""
    planning = PlanningConfig()
    load(planning.strategy)  # what is compiled is not part of a verdict's time
    physics = ElasticRod() if case.dlo.yield_curvature_1_m is None else ElastoplasticChain()
    cell = Cell(CellConfig(dlo=case.dlo, physics=physics, randomised=EVERY_FACTOR), seed=case.seed)
    rng = np.random.default_rng([case.seed, *case.dlo.name.encode()])
    try:
        return [judged for name, curve in _goals(case) for judged in _judge(case, name, curve, cell, planning, rng)]
    finally:
        cell.close()


def judge_cases(todo: Sequence[FeasibilityCase], jobs: int) -> Iterator[tuple[int, list[Judged]]]:
    """Every case as it is done, with its place in `todo`; side by side in so many processes."""
    if jobs == 1:
        yield from ((at, judge_case(case)) for at, case in enumerate(todo))
        return
    parallel: Any = Parallel(n_jobs=jobs, return_as="generator_unordered")
    yield from parallel(delayed(_numbered)(at, case) for at, case in enumerate(todo))


def _numbered(at: int, case: FeasibilityCase) -> tuple[int, list[Judged]]:
    return at, judge_case(case)


def _goals(case: FeasibilityCase) -> Iterator[tuple[str, Float64Array]]:
    dlo = case.dlo
    if not case.curves:
        yield from made_goals(case.seed, dlo.length_m, dlo.radius_m)
    for name, curve in case.curves.items():
        yield name, placed(curve, dlo.length_m, dlo.radius_m)


def _judge(
    case: FeasibilityCase,
    name: str,
    curve: Float64Array,
    cell: Cell,
    planning: PlanningConfig,
    rng: np.random.Generator,
) -> Iterator[Judged]:
    nodes = BelievedDlo().nodes
    what = release(cell, curve, nodes, case.threshold_m)
    for level in Level:
        knowledge = known(level, case.dlo, cell, rng)
        started_s = time.process_time()
        verdict = asyncio.run(_verdict(geometry.resample(curve, nodes), knowledge, planning, case.threshold_m))
        yield Judged(
            dlo=case.dlo.name,
            goal=name,
            level=level,
            standing=verdict.standing,
            happened=what.happened,
            true_rmse_m=what.true_rmse_m,
            best_rmse_m=what.best_rmse_m,
            verdict_s=time.process_time() - started_s,
        )


async def _verdict(
    goal_world: Float64Array, knowledge: KnownDlo, planning: PlanningConfig, threshold_m: float
) -> GoalVerdict:
    model = knowledge.model

    async def try_goal(nodes_world: Float64Array) -> goal_verdict.HoldVerdict:
        return goal_verdict.try_goal(model, knowledge.belief, nodes_world, threshold_m, planning.feasibility)

    place = Workplace(model, planning.feasibility, ArmKinematics(PANDA).reachable, default_calibration())
    goal = GoalShape(stamp_ns=0, nodes_world=goal_world)
    return await judge(goal, threshold_m, place=place, try_goal=try_goal)
