"""Constructed results of runs, for tests of statistics, tables and plots."""

import msgspec
import numpy as np
from made_results import made_action

from dlokit.description import shapes
from dlokit.extras.bench.shaping.cases import CaseResult, CaseShapes, ShapingCase, ShapingMethod
from dlokit.extras.bench.shaping.experiments import BuiltInGoal, Experiment
from dlokit.system.results.run_result import ActionResult, RunResult, VerdictResult
from dlokit.types.feasibility import Standing
from dlokit.types.flow import RunOutcome

FARTHEST = ShapingMethod(observer="map", planner="farthest")
ROLLOUT = ShapingMethod(observer="map", planner="rollout")
BENT = Experiment(name="I to S", start="I", goal=BuiltInGoal(name="S"), groups=("bent",))
STRAIGHT = Experiment(name="S to I", start="S", goal=BuiltInGoal(name="I"))


def action(number: int, rmse_m: float, kind: str = "drag") -> ActionResult:
    """One action of 10 s of the robot and 1 m of its tool, chosen in `number` seconds."""
    return made_action(number, kind, rmse_m=rmse_m, duration_s=12.0, robot_time_s=10.0, planning_time_s=float(number))


def run(
    errors_m: list[float],
    *,
    outcome: RunOutcome = RunOutcome.CONVERGED,
    true_m: float | None = None,
    said: Standing | None = Standing.HOLDS,
    projected: bool = False,
) -> RunResult:
    """A run, given by its errors before the first action and after each."""
    rows = tuple(action(number, error) for number, error in enumerate(errors_m[1:], start=1))
    true_m = errors_m[-1] if true_m is None else true_m
    return RunResult(
        outcome=outcome,
        actions=len(rows),
        rmse_m=errors_m[-1],
        start_rmse_m=errors_m[0],
        true_rmse_m=true_m,
        true_largest_m=2.0 * true_m,
        threshold_m=0.012,
        seed=0,
        sim_time_s=30.0,
        wall_time_s=10.0,
        planning_time_s=1.0,
        history=rows,
        config_hash="",
        version="",
        goal_verdict=None if said is None else VerdictResult(standing=said, text="", projected=projected),
    )


def done(
    result: RunResult,
    experiment: Experiment = BENT,
    *,
    seed: int = 0,
    method: ShapingMethod = FARTHEST,
    drawn: bool = True,
) -> CaseResult:
    """A case with that result."""
    line = shapes.builtin_shape("I", 0.5, 31)
    ways = CaseShapes(start_world=line, goal_world=line, final_world=line) if drawn else None
    result = msgspec.structs.replace(result, seed=seed)
    case = ShapingCase(experiment=experiment, seed=seed, method=method)
    return CaseResult(case=case, result=result, shapes=ways, fault=None if drawn else "ValueError: by the test")


def same_shapes(one: CaseShapes, other: CaseShapes) -> bool:
    """Whether two cases have the same content."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in CaseShapes.__dataclass_fields__)
