"""`dlokit bench feasibility`: verdicts on goals against what the cell does with its DLO laid there and released.

The model's beliefs are off by what the shipped ones are off for the default rope: 1.3 times as stiff, 1.17 times as
heavy, a friction of 0.75 times. Nobody plans: this judges the verdict alone.
"""

import asyncio
import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dlokit import geometry
from dlokit.bench.evaluator import SETTLE_S
from dlokit.description import shapes
from dlokit.description.dlo import DloPreset
from dlokit.description.scene import default_calibration
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.skills.model.belief import as_configured
from dlokit.skills.model.config import BeliefConfig, ModelConfig
from dlokit.skills.planning import holding
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.feasibility import Workplace
from dlokit.skills.planning.goal_verdict import judge
from dlokit.skills.robot.kinematics import PandaKinematics
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing

_CURVE_POINTS = 101
_STIFFER, _HEAVIER, _SMOOTHER = 1.3, 1.17, 0.75


class Happened(enum.Enum):
    """What the cell's DLO did."""

    STAYED = "stayed"
    """It stayed within the threshold."""
    NEAR = "near"
    """It did not, but moved on the table its last shape is within the threshold: a planner may get there."""
    SPRANG_BACK = "sprang_back"


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One goal, one DLO: what was said, and what happened."""

    goal: str
    dlo: str
    standing: Standing
    happened: Happened
    true_rmse_m: float
    """How far the cell's DLO sprang back [m]."""


def goals(curves: Mapping[str, Float64Array], length_m: float, radius_m: float) -> Iterator[tuple[str, Float64Array]]:
    """The built-in shapes, then `curves` (K, 3) [m] scaled to the DLO and moved to the middle of the table."""
    for name in shapes.BUILTIN_SHAPES:
        yield name, shapes.builtin_shape(name, length_m, _CURVE_POINTS, radius_m=radius_m)
    for name, curve in curves.items():
        nodes = shapes.fit_length(curve, length_m)
        middle = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2.0
        placed = geometry.resample(shapes.moved(nodes, np.array(shapes.CENTRE_M) - middle), _CURVE_POINTS)
        placed[:, 2] = radius_m
        yield name, placed


def judge_all(
    curves: Mapping[str, Float64Array], config: CellConfig, planning: PlanningConfig, threshold_m: float
) -> Iterator[Judged]:
    """Judge every goal for the DLO that lies in a cell, and release it there."""
    cell = Cell(config, seed=0)
    model = beliefs(config.dlo)
    try:
        for name, curve in goals(curves, config.dlo.length_m, config.dlo.radius_m):
            goal = geometry.resample(curve, model.nodes)
            verdict = asyncio.run(_verdict(goal, model, planning, threshold_m))
            cell.place_dlo(curve, settle=False)
            cell.step(SETTLE_S)
            rested = geometry.resample(cell.true_nodes_world(), model.nodes)
            yield Judged(
                goal=name,
                dlo=config.dlo.name,
                standing=verdict.standing,
                happened=_happened(rested, goal, threshold_m),
                true_rmse_m=geometry.rmse_m(rested, goal),
            )
    finally:
        cell.close()


def beliefs(dlo: DloPreset) -> ModelConfig:
    """A model that knows a DLO as well as the shipped one knows the default rope."""
    return replace(
        ModelConfig(length_m=dlo.length_m, radius_m=dlo.radius_m, belief=BeliefConfig(takes_set=0.0)),
        bending_stiffness_n_m2=_STIFFER * dlo.bending_stiffness_n_m2,
        mass_kg_m=_HEAVIER * dlo.mass_per_length_kg_m,
        friction=_SMOOTHER * dlo.friction,
    )


async def _verdict(
    goal_world: Float64Array, model: ModelConfig, planning: PlanningConfig, threshold_m: float
) -> GoalVerdict:
    async def try_goal(nodes_world: Float64Array) -> holding.Hold:
        return holding.try_goal(model, as_configured(model, 0), nodes_world, threshold_m, planning.feasibility)

    place = Workplace(planning.feasibility, planning.actions.grasp, PandaKinematics().reachable, default_calibration())
    goal = GoalShape(stamp_ns=0, nodes_world=goal_world)
    return await judge(
        goal, threshold_m, place=place, length_m=model.length_m, radius_m=model.radius_m, try_goal=try_goal
    )


def _happened(rested_world: Float64Array, goal_world: Float64Array, threshold_m: float) -> Happened:
    if geometry.rmse_m(rested_world, goal_world) <= threshold_m:
        return Happened.STAYED
    if geometry.rmse_m(holding.aligned(rested_world, goal_world), goal_world) <= threshold_m:
        return Happened.NEAR
    return Happened.SPRANG_BACK
