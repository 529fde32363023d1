"""Goals of the suites, as curves for a rod of any length."""

from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description import shapes
from dlokit.types.arrays import Float64Array

CURVE_POINTS = 101
"""Starts and goals are finer than either rod, and resampled by each."""
RAMP_M = 0.025
"""Length over which the curvature of a bend rises from zero [m], as in the built-in S: a jump would take a shear
force that friction cannot give."""


@dataclass(frozen=True, kw_only=True)
class BuiltInGoal:
    """One of the built-in shapes, where it lies or moved."""

    name: str
    moved_by_m: tuple[float, float] = (0.0, 0.0)
    turned_by_rad: float = 0.0

    def nodes_world(self, length_m: float, radius_m: float) -> Float64Array:
        """The goal (CURVE_POINTS, 3) [m] of a rod of that length and radius [m]."""
        nodes = shapes.builtin_shape(self.name, length_m, CURVE_POINTS, radius_m=radius_m)
        return shapes.moved(nodes, self.moved_by_m, self.turned_by_rad) if self.is_moved else nodes

    @property
    def is_moved(self) -> bool:
        """Whether it lies elsewhere than the built-in shape."""
        return self.moved_by_m != (0.0, 0.0) or self.turned_by_rad != 0.0


@dataclass(frozen=True, kw_only=True)
class CurveGoal:
    """A curve of a file: scaled to the rod, the middle of its extent in the middle of the table."""

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
    """An S of two opposite arcs of one radius, with straight ends as long as there is rod left."""

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


GoalCurve = BuiltInGoal | CurveGoal | BentGoal
"""Every kind of goal."""
