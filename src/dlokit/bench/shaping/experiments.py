"""One experiment of a suite: what lies on the table, how it starts, where it shall go."""

from dataclasses import dataclass, replace

import numpy as np

from dlokit.bench.shaping.goal_curves import CURVE_POINTS, GoalCurve
from dlokit.description import shapes
from dlokit.description.dlo import DloPreset
from dlokit.skills.model.config import BeliefConfig
from dlokit.system.config import RunConfig, with_dlo
from dlokit.types.arrays import Float64Array

RANDOM = "random"
TOLD_STIFFER, TOLD_HEAVIER, TOLD_SMOOTHER = 1.3, 1.17, 0.75
"""What a lab tells the system of a rod whose stiffness it has measured, over what is so: as far off as the shipped
beliefs are for the shipped rope."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A start and a goal; each seed makes a case of it."""

    name: str
    start: str
    """I, S, or random: drawn from the seed."""
    goal: GoalCurve
    groups: tuple[str, ...] = ()
    """Rows of the table that its runs count in as well."""
    dlo: DloPreset | None = None
    """What lies on the table; None: what the configuration says."""
    told: bool = False
    """Whether the system is told stiffness, weight and friction as well, as far as a lab knows them; else it knows
    length and radius alone."""
    seed_offset: int = 0
    """Added to the seed of each of its runs, so that experiments draw different starts and cells."""

    def configured(self, config: RunConfig) -> RunConfig:
        """The configuration with this experiment's DLO."""
        if self.dlo is None:
            return config
        run = with_dlo(config, self.dlo)
        if not self.told:
            return run
        model = replace(
            run.model,
            bending_stiffness_n_m2=TOLD_STIFFER * self.dlo.bending_stiffness_n_m2,
            mass_kg_m=TOLD_HEAVIER * self.dlo.mass_per_length_kg_m,
            friction=TOLD_SMOOTHER * self.dlo.friction,
            # As sure as of the shipped figures, and a lab knows of a rope that it springs back.
            belief=BeliefConfig(takes_set=0.0),
        )
        return replace(run, model=model)

    def start_world(self, dlo: DloPreset, run_seed: int) -> Float64Array:
        """Where the cell's DLO lies first, (CURVE_POINTS, 3) [m].

        A random start bends no tighter than friction can hold for that DLO; for the rope it is the one of
        ``dlokit shape --start random --seed K``.
        """
        if self.start != RANDOM:
            return shapes.builtin_shape(self.start, dlo.length_m, CURVE_POINTS, radius_m=dlo.radius_m)
        return shapes.random_shape(
            np.random.default_rng([run_seed, 0]),
            dlo.length_m,
            CURVE_POINTS,
            radius_m=dlo.radius_m,
            min_bend_radius_m=max(shapes.MIN_BEND_RADIUS_M, dlo.smallest_held_radius_m),
        )
