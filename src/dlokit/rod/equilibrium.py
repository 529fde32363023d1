"""The shape nearest to a goal that friction can hold: statics of a bent rod on a level table.

A rod rests when friction can balance the elastic force at every node. With headings θ of its edges, curvature κ,
and the shear Q = -EI κ' and tension T of each edge, the force on the node between edges i - 1 and i is

    f_i = (T_i t_i + Q_i n_i) - (T_{i-1} t_{i-1} + Q_{i-1} n_{i-1}),    |f_i| ≤ μ w l,

with t, n along and across an edge of length l, and w the weight per length. T is free, because the rod does not
stretch. Divided by μ w l, the problem depends on the rod only through EI / (μ w). The nearest shape solves min |x(θ) -
goal|² under these bounds, by sequential quadratic programming with a trust region (Nocedal and Wright, *Numerical
Optimization*, 2006, section 18.5).
"""

from dataclasses import dataclass

import daqp
import numpy as np

from dlokit import geometry
from dlokit.types.arrays import BoolArray, Float64Array

_SIDES = 8  # of the polygon around the circle of friction
_PENALTY = 2e4  # penalty on missing friction, in units of squared RMSE over its scale
_SCALE_M = 1e-3  # RMSE that contributes 1 to the objective
_ITERATIONS = 16
_TURN_RAD = 0.3  # initial trust region
_WIDEST_RAD, _NARROWEST_RAD = 0.6, 1e-3
_ENOUGH = 1e-3  # a smaller relative decrease counts as no progress
_UNBOUNDED = 1e30
# Curvature added to the objective for each kind of variable, so that each step has a unique minimum. With less (the
# slack has none of its own) rounding decided which constraints the solver activated, and it often failed.
_PROXIMAL_TURN = 1e-3
_PROXIMAL_TENSION = 1e-4
_PROXIMAL_LACKING = 1.0


@dataclass(frozen=True)
class StaticShape:
    """A shape that friction holds, near a goal."""

    nodes_world: Float64Array  # (M, 3) [m]
    rmse_m: float
    """RMSE to the goal [m]."""
    lacking: float
    """Missing friction at the worst node, as a fraction of the available friction (or excess bend there in radians);
    far below 0.1, the shape holds."""


def nearest_static(
    goal_world: Float64Array,
    elastic_m3: float,
    *,
    min_radius_m: float = 0.0,
    yield_curvature_1_m: float = np.inf,
    supported: BoolArray | None = None,
) -> StaticShape:
    """The shape nearest to a goal (M, 3) [m] that a rod of ``EI / (μ w)`` = `elastic_m3` [m³] can keep on a table.

    A release in the goal can lead to another shape, because the rod can be placed there with any tension. No bend is
    tighter than `min_radius_m`. A rod that yields at a curvature [1/m] is assumed to be straight at first and to keep
    the curvature in excess of the yield curvature. The minimum is a local one, found from the goal. An octagon around
    the circle of friction approximates it, so that no shape is omitted. Nodes that are `supported` (M,), because they
    may lean on a post, need no friction.
    """
    problem = _Problem(goal_world, elastic_m3, min_radius_m, yield_curvature_1_m, supported)
    now, within_rad = problem.at(problem.headings(), np.zeros(problem.edges)), _TURN_RAD
    for _ in range(_ITERATIONS):
        step = problem.step(now, within_rad)
        then = None if step is None else problem.at(now.theta + step[0], step[1])
        if then is None or then.cost >= now.cost:
            within_rad /= 3.0
            if within_rad < _NARROWEST_RAD:
                break
            continue
        progress, now = now.cost - then.cost, then
        within_rad = min(1.6 * within_rad, _WIDEST_RAD)
        if progress < _ENOUGH * now.cost:
            break
    nodes = goal_world.copy()
    nodes[:, :2] = now.nodes + goal_world[:, :2].mean(axis=0)
    return StaticShape(nodes_world=nodes, rmse_m=geometry.rmse_m(nodes, goal_world), lacking=now.lacking)


@dataclass(frozen=True)
class _Point:
    """Headings and tensions, and the quantities derived from them."""

    theta: Float64Array  # (E,) [rad]
    tension: Float64Array  # (E,) of μ w l
    shear: Float64Array  # (E,)
    force: Float64Array  # (2, M) of μ w l, along and across the edge after each node
    nodes: Float64Array  # (M, 2) [m] about their mean
    lacking: float
    cost: float


class _Problem:
    """M nodes and E = M - 1 edges of length l; forces in units of μ w l."""

    def __init__(
        self,
        goal_world: Float64Array,
        elastic_m3: float,
        min_radius_m: float,
        yield_curvature_1_m: float,
        supported: BoolArray | None,
    ) -> None:
        count = len(goal_world)
        self._by_friction = slice(None) if supported is None else np.flatnonzero(~supported)  # the nodes it must hold
        self.edges = count - 1
        goal = goal_world[:, :2]
        self._goal = goal - goal.mean(axis=0)
        length_m = float(geometry.arc_lengths(goal)[-1]) / self.edges
        reach = np.vstack((np.zeros(self.edges), np.tril(np.full((self.edges, self.edges), length_m))))
        self._reach = reach - reach.mean(axis=0)  # (M, E): nodes about their mean from directions of edges
        self._after, self._before = np.eye(count, self.edges), np.eye(count, self.edges, -1)  # edges at a node
        self._bend = self._after - self._before  # (M, E): turning angles; the ends are free
        self._bend[[0, -1]] = 0.0
        self._differ = -elastic_m3 / length_m**3 * (self._after - self._before).T  # (E, M): shear from elastic turns
        self._most_rad = length_m / min_radius_m if min_radius_m > 0.0 else np.inf  # turning angle at a node
        self._yield_rad = yield_curvature_1_m * length_m
        angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        self._sides = np.column_stack((np.cos(angles), np.sin(angles)))  # (K, 2)
        self._weight = 1.0 / (_SCALE_M**2 * count)

    def headings(self) -> Float64Array:
        """Headings (E,) [rad] of the goal."""
        along = np.diff(self._goal, axis=0)
        return np.unwrap(np.arctan2(along[:, 1], along[:, 0]))

    def at(self, theta: Float64Array, tension: Float64Array) -> _Point:
        """The shear, forces and nodes for headings (E,) [rad] and tensions (E,)."""
        turn = self._bend @ theta
        shear = self._differ @ np.clip(turn, -self._yield_rad, self._yield_rad)
        cosine, sine = np.cos(turn), np.sin(turn)
        pulled, sheared = self._before @ tension, self._before @ shear
        force = np.stack(
            (
                self._after @ tension - cosine * pulled - sine * sheared,
                self._after @ shear + sine * pulled - cosine * sheared,
            )
        )
        nodes = self._reach @ np.column_stack((np.cos(theta), np.sin(theta)))
        needed = float((self._sides @ force[:, self._by_friction]).max(initial=0.0))
        lacking = max(0.0, needed - 1.0, float(np.abs(turn).max()) - self._most_rad)
        off = self._weight * float(((nodes - self._goal) ** 2).sum())
        return _Point(theta, tension, shear, force, nodes, lacking, off / 2.0 + _PENALTY * lacking)

    def step(self, point: _Point, within_rad: float) -> tuple[Float64Array, Float64Array] | None:
        """Optimal first-order change of the headings (E,) and new tensions (E,); None if the solver failed.

        Variables are the change of θ, T, and the missing friction (slack).
        """
        edges = self.edges
        jacobian = np.vstack((self._reach * -np.sin(point.theta), self._reach * np.cos(point.theta)))  # (2 M, E)
        off = (point.nodes - self._goal).T.ravel()
        proximal = np.repeat((_PROXIMAL_TURN, _PROXIMAL_TENSION, _PROXIMAL_LACKING), (edges, edges, 1))
        quadratic = np.diag(proximal)
        quadratic[:edges, :edges] += self._weight * jacobian.T @ jacobian
        linear = np.concatenate((self._weight * jacobian.T @ off, -_PROXIMAL_TENSION * point.tension, [_PENALTY]))
        by_theta, by_tension = self._force_jacobians(point)
        # Forces to first order, with T recomputed.
        fixed = point.force - by_tension @ point.tension  # (2, M)
        rows = np.tensordot(self._sides, np.concatenate((by_theta, by_tension), axis=2), axes=1)  # (K, M, 2 E)
        rows = rows[:, self._by_friction].reshape(-1, 2 * edges)
        room = [1.0 - (self._sides @ fixed)[:, self._by_friction].ravel()]
        if np.isfinite(self._most_rad):
            turn, none = self._bend @ point.theta, np.zeros_like(self._bend)
            rows = np.vstack((rows, np.hstack((self._bend, none)), np.hstack((-self._bend, none))))
            room += [self._most_rad - turn, self._most_rad + turn]
        rows = np.column_stack((rows, np.full(len(rows), -1.0)))  # minus the slack
        upper = np.concatenate((np.full(edges, within_rad), np.full(edges + 1, _UNBOUNDED), *room))
        lower = np.full(len(upper), -_UNBOUNDED)
        lower[:edges], lower[2 * edges] = -within_rad, 0.0
        found = _solved(quadratic, linear, rows, lower, upper)
        return None if found is None else (found[:edges], found[edges : 2 * edges])

    def _force_jacobians(self, point: _Point) -> tuple[Float64Array, Float64Array]:
        """Derivatives of the forces by θ and by T, both (2, M, E)."""
        turn = self._bend @ point.theta
        cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
        pulled, sheared = (self._before @ point.tension)[:, None], (self._before @ point.shear)[:, None]
        by_tension = np.stack((self._after - cosine * self._before, sine * self._before))
        elastic = self._bend * (np.abs(turn) < self._yield_rad)[:, None]
        before, after = (edges @ self._differ @ elastic for edges in (self._before, self._after))
        by_theta = np.stack(
            (
                -sine * before + (sine * pulled - cosine * sheared) * self._bend,
                after - cosine * before + (cosine * pulled + sine * sheared) * self._bend,
            )
        )
        return by_theta, by_tension


def _solved(
    quadratic: Float64Array, linear: Float64Array, rows: Float64Array, lower: Float64Array, upper: Float64Array
) -> Float64Array | None:
    """The minimum (n,) of xᵀ `quadratic` x / 2 + `linear` · x; None: the solver failed.

    `lower` and `upper` (n + m,) bound x itself, then `rows` (m, n) x. Variables are scaled to curvature 1 and rows to
    length 1: radians, forces and slack differ by orders of magnitude, and the solver's tolerances are absolute.
    """
    count = len(linear)
    scale = 1.0 / np.sqrt(np.diag(quadratic))
    rows = rows * scale
    bounds = 1.0 / np.concatenate((scale, np.linalg.norm(rows, axis=1)))
    found, _, flag, _ = daqp.solve(
        quadratic * np.outer(scale, scale),
        linear * scale,
        np.ascontiguousarray(rows * bounds[count:, None]),
        upper * bounds,
        lower * bounds,
    )
    return np.asarray(found, dtype=np.float64) * scale if flag > 0 else None
