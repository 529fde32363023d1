"""What the system is told of the bench's DLOs: nothing but their size, what a data sheet tells, or what was learnt."""

import enum
import math
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from dlokit.description.dlo import GRAVITY_M_S2, SOFT_ROPE, DloPreset
from dlokit.extras.bench.shaping.experiments import MEASURED_HEAVIER, MEASURED_SMOOTHER, MEASURED_STIFFER
from dlokit.functional.cell.world import TABLE_FRICTION, Cell
from dlokit.rod.believed import BeliefConfig, BelievedDlo, as_configured, with_belief
from dlokit.system.config import RunConfig, with_dlo
from dlokit.types.dlo import DloBelief, LogNormal

_LEARNT_LOG_SD, _LEARNT_YIELD_LOG_SD = 0.12, 0.2

BENCH_DLOS = (
    SOFT_ROPE,
    replace(SOFT_ROPE, name="firm_rope", bending_stiffness_n_m2=1e-4),
    replace(SOFT_ROPE, name="stiff_rope", bending_stiffness_n_m2=1e-3),
)
"""Elastic ropes of rising stiffness; the last two are for this bench alone."""


class Level(enum.Enum):
    """How much is known of the DLO."""

    RULER = "ruler"
    """Length and radius; the rest as shipped."""
    TOLD = "told"
    """Nominal figures, off by what the shipped ones are off for the soft rope, and whether it takes a set."""
    LEARNT = "learnt"
    """Drawn around the truth of the drawn cell: EI / (μ w) to 12 %, the yield curvature to 20 % (1 sd)."""


@dataclass(frozen=True)
class KnownDlo:
    """What a verdict is given."""

    model: BelievedDlo
    belief: DloBelief


def true_elastic_m3(cell: Cell) -> float:
    """EI / (μ w) [m³] of the DLO in a cell as it was drawn, with the mean friction of the table's quarters."""
    dlo, drawn = cell.config.dlo, cell.drawn
    table = TABLE_FRICTION * drawn.friction_factor
    friction = max(table, dlo.friction) * float(np.mean(drawn.friction_regions))
    return dlo.bending_stiffness_n_m2 / (friction * GRAVITY_M_S2 * dlo.mass_per_length_kg_m)


def known(level: Level, nominal: DloPreset, cell: Cell, rng: np.random.Generator) -> KnownDlo:
    """What is known at a level of a DLO with `nominal` figures that lies in a `cell` as it was drawn."""
    match level:
        case Level.RULER:
            model = with_dlo(RunConfig(), nominal).model
            return KnownDlo(model, as_configured(model, 0))
        case Level.TOLD:
            model = told(nominal)
            return KnownDlo(model, as_configured(model, 0))
        case Level.LEARNT:
            return _learnt(told(nominal), cell, rng)


def told(dlo: DloPreset) -> BelievedDlo:
    """A model that knows a DLO as well as the shipped one knows the soft rope, and whether it takes a set."""
    return BelievedDlo(
        length_m=dlo.length_m,
        radius_m=dlo.radius_m,
        bending_stiffness_n_m2=MEASURED_STIFFER * dlo.bending_stiffness_n_m2,
        mass_kg_m=MEASURED_HEAVIER * dlo.mass_per_length_kg_m,
        friction=MEASURED_SMOOTHER * dlo.friction,
        yield_curvature_1_m=dlo.yield_curvature_1_m,
        belief=BeliefConfig(takes_set=0.0),
    )


def _learnt(model: BelievedDlo, cell: Cell, rng: np.random.Generator) -> KnownDlo:
    elastic_m3 = true_elastic_m3(cell) * math.exp(rng.normal() * _LEARNT_LOG_SD)
    bend_1_m, bend_factor = cell.config.dlo.yield_curvature_1_m, math.exp(rng.normal() * _LEARNT_YIELD_LOG_SD)
    before = as_configured(model, 0)
    stiffness_n_m2 = elastic_m3 * before.friction.value * before.weight_n_m.value
    belief = msgspec.structs.replace(
        before,
        bending_stiffness_n_m2=LogNormal(value=stiffness_n_m2, log_sd=before.bending_stiffness_n_m2.log_sd),
        elastic_m3=LogNormal(value=elastic_m3, log_sd=_LEARNT_LOG_SD),
        yield_curvature_1_m=None if bend_1_m is None else bend_1_m * bend_factor,
        actions=1,
    )
    return KnownDlo(with_belief(model, belief), belief)
