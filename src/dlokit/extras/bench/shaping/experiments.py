"""One experiment of a suite: the DLO, its start, and the goal curve."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlokit import geometry
from dlokit.description import shapes
from dlokit.description.dlo import SOFT_ROPE, DloPreset
from dlokit.description.passing import wish_along
from dlokit.description.scene import Fixture
from dlokit.description.shapes import CURVE_POINTS, RAMP_M
from dlokit.extras.bench.shaping import among_posts
from dlokit.extras.bench.shaping.among_posts import PlacedGoal
from dlokit.rod.believed import BeliefConfig
from dlokit.system.config import RunConfig, with_dlo
from dlokit.types.arrays import Float64Array
from dlokit.types.passing import SideWish


@dataclass(frozen=True, kw_only=True)
class BuiltInGoal:
    """One of the built-in shapes, at its place or moved."""

    name: str
    moved_by_m: tuple[float, float] = (0.0, 0.0)
    turned_by_rad: float = 0.0

    def nodes_world(self, length_m: float, radius_m: float) -> Float64Array:
        """The goal (CURVE_POINTS, 3) [m] of a rod of that length and radius [m]."""
        nodes = shapes.builtin_shape(self.name, length_m, CURVE_POINTS, radius_m=radius_m)
        return shapes.moved(nodes, self.moved_by_m, self.turned_by_rad) if self.is_moved else nodes

    @property
    def is_moved(self) -> bool:
        """Whether it is moved from the place of the built-in shape."""
        return self.moved_by_m != (0.0, 0.0) or self.turned_by_rad != 0.0


@dataclass(frozen=True, kw_only=True)
class CurveGoal:
    """A curve of a file, scaled to the rod and centred on the table."""

    points_m: tuple[tuple[float, float], ...]
    """(x, y) [m], in order along the rod, of any length and anywhere."""

    def nodes_world(self, length_m: float, radius_m: float) -> Float64Array:
        """The goal (CURVE_POINTS, 3) [m] of a rod of that length and radius [m]."""
        flat = np.array(self.points_m, dtype=np.float64)
        points = np.column_stack([flat, np.full(len(flat), radius_m)])
        nodes = geometry.resample(shapes.fit_length(points, length_m), CURVE_POINTS)
        middle = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2.0
        return shapes.moved(nodes, np.array(shapes.CENTRE_M) - middle)


@dataclass(frozen=True, kw_only=True)
class BentGoal:
    """An S of two opposite arcs of equal radius, with straight ends of the remaining length."""

    turn_rad: float
    """Angle that each arc turns by."""
    bend_radius_m: float
    """Radius of the arcs [m]."""

    def nodes_world(self, length_m: float, radius_m: float) -> Float64Array:
        """The goal (CURVE_POINTS, 3) [m] of a rod of that length and radius [m]."""
        plateau = self.turn_rad * self.bend_radius_m - RAMP_M
        first = length_m / 2.0 - plateau - 2.0 * RAMP_M
        half = np.cumsum([first, RAMP_M, plateau, RAMP_M])
        corners = np.concatenate(([0.0], half, length_m - half[-2::-1], [length_m]))
        values = np.array([0.0, 0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0, 0.0]) / self.bend_radius_m
        curvature = np.interp(np.linspace(0.0, length_m, 4 * (CURVE_POINTS - 1) + 1), corners, values)
        return shapes.from_curvature(curvature, length_m, CURVE_POINTS, radius_m=radius_m)


GoalCurve = BuiltInGoal | CurveGoal | BentGoal | PlacedGoal
"""Every kind of goal."""


RANDOM = "random"
MEASURED_STIFFER, MEASURED_HEAVIER, MEASURED_SMOOTHER = 1.3, 1.17, 0.75
"""Uncertainty of a lab's measurement, as a ratio: the uncertainty of the default beliefs for the default rope."""


def _as_text(wish: Sequence[SideWish]) -> str:
    return " ".join(f"{'+' if one.turn > 0 else '-'}{one.name}" for one in wish)


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A start and a goal; each seed makes a case of it."""

    name: str
    start: str
    """I, S, or random: drawn from the seed."""
    goal: GoalCurve
    groups: tuple[str, ...] = ()
    """Further table rows that count its runs."""
    dlo: DloPreset | None = None
    """DLO on the table; None: the configured one."""
    told: bool = False
    """Whether the system's model gets measured stiffness, weight and friction, or only length and radius."""
    seed_offset: int = 0
    """Added to the seed of each of its runs, so that experiments draw different starts and cells."""
    fixtures: tuple[Fixture, ...] = ()
    """What stands on the table, in place of what the installation has."""
    drawn: bool = False
    """Whether fixtures and goal are drawn from the seed of the run, in place of those above."""

    def of_seed(self, run_seed: int) -> "Experiment":
        """The experiment of one run: with what is drawn from its seed."""
        if not self.drawn:
            return self
        fixtures, goal = among_posts.drawn(run_seed, self.start_world(self.dlo or SOFT_ROPE, run_seed))
        return replace(self, fixtures=fixtures, goal=goal, drawn=False)

    def configured(self, config: RunConfig) -> RunConfig:
        """The configuration with this experiment's fixtures and DLO."""
        run = config if self.dlo is None else with_dlo(config, self.dlo)
        if self.fixtures:
            goal = self.goal.nodes_world(run.model.length_m, run.model.radius_m)
            installation = replace(run.installation, fixtures=self.fixtures)
            run = replace(run, installation=installation, beside=_as_text(wish_along(goal, self.fixtures)))
        if self.dlo is None or not self.told:
            return run
        model = replace(
            run.model,
            bending_stiffness_n_m2=MEASURED_STIFFER * self.dlo.bending_stiffness_n_m2,
            mass_kg_m=MEASURED_HEAVIER * self.dlo.mass_per_length_kg_m,
            friction=MEASURED_SMOOTHER * self.dlo.friction,
            # The same uncertainty as for the default figures; that a rope is elastic needs no measurement.
            belief=BeliefConfig(takes_set=0.0),
        )
        return replace(run, model=model)

    def start_world(self, dlo: DloPreset, run_seed: int) -> Float64Array:
        """Initial shape of the cell's DLO, (CURVE_POINTS, 3) [m].

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
            fixtures=self.fixtures,
        )
