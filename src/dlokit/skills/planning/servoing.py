"""Shape servoing: decide whether control follows an action, and choose the next correction of a held DLO.

The controller computes the Jacobian at the observed shape, updates it with the effects of earlier corrections, and
chooses the correction with the smallest predicted error after the release (McConachie et al., IJRR 2020).

The Jacobian is the derivative of the shape after a release by small motions of the tool before it. It is computed by
finite differences with the planning rod, which is dragged, released, and comes to rest.

A correction moves node i by d_i; the error left at it is e_i, seen with covariance P_i. Its gain in mean square is
(1/M) Σ (2 e_i · d_i - |d_i|²), in which only the first term is seen. The errors of neighbours are
correlated, so the standard deviations of that term are added: (2/M) Σ sqrt(d_iᵀ P_i d_i).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description.scene import NO_POSTS
from dlokit.ranges import Fraction, Positive, check_ranges
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import UNCERTAINTY, Motion, PlanningRod, rods_around, simulate, waypoints_of
from dlokit.skills.planning.base import Reachable
from dlokit.skills.planning.room import HandRoom
from dlokit.types.action import (
    Action,
    ControlAdvice,
    ControlForecast,
    ControlVerdict,
    Correction,
    GraspedNode,
    VelocityProfile,
)
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.pose import Pose

STILL = np.zeros(4)
VELOCITY = VelocityProfile(speed_m_s=0.1, acceleration_m_s2=1.0, jerk_m_s3=10.0)
"""Velocity of the tool during a correction: slow, because the rod is dragged."""
LARGEST_M = 0.03
"""Longest correction [m]: the Jacobian is valid near the current shape."""
LARGEST_RAD = 0.5
"""Largest turn of one correction [rad]."""
TRUST = 0.5
"""Largest part of the last corrections' prediction error that updates the Jacobian, relative to the prediction;
more is cut off."""
TIMESTEP_S = 0.005
"""Step of the planning rod [s]."""
_PROBE_M = 0.008  # displacement of the tool for finite differences: enough to overcome friction
_PROBE_RAD = 0.15  # turn of the tool for finite differences
_DAMPING_M = 0.003  # directions that move the nodes by less than this (RMS) per `_PROBE_M` are damped


@dataclass(frozen=True)
class Grip:
    """A held node and the tool that holds it."""

    node: int
    tool: Float64Array  # (4,) x, y, z [m], yaw [rad]


def released(
    model: BelievedDlo,
    nodes_world: Float64Array,
    grip: Grip,
    displacements: Sequence[Float64Array],
    posts: Float64Array = NO_POSTS,
) -> Float64Array:
    """The shapes (C, M, 3) [m] of a held rod (M, 3) at rest, released after each displacement (4,).

    `posts` (P, 8) are from `Scene.posts_world`.
    """
    motions = tuple(
        Motion(node=grip.node, waypoints=np.stack((grip.tool, grip.tool + by)), velocity=VELOCITY)
        for by in displacements
    )
    return simulate(model, nodes_world, (PlanningRod(),), motions, TIMESTEP_S, posts=posts).nodes_world[0]


def probes() -> list[Float64Array]:
    """The displacements for the Jacobian: none, then in both directions along x, y and about z."""
    steps = np.diag([_PROBE_M, _PROBE_M, 0.0, _PROBE_RAD])
    return [STILL, *(sign * steps[axis] for axis in (0, 1, 3) for sign in (1.0, -1.0))]


def jacobian(shapes: Float64Array) -> Float64Array:
    """The Jacobian (2 M, 3) of the nodes' x, y by the tool's x, y and turn, from the shapes (7, M, 3) [m] of `probes`.

    A turn counts in lengths, `_PROBE_RAD` as `_PROBE_M`, so that all columns have one unit.
    """
    flat = shapes[:, :, :2].reshape(len(shapes), -1)
    return (flat[1::2] - flat[2::2]).T / (2.0 * _PROBE_M)


def scaled(displacement: Float64Array) -> Float64Array:
    """The Jacobian's coordinates (3,) [m] of a displacement (4,)."""
    return np.array([displacement[0], displacement[1], displacement[3] * _PROBE_M / _PROBE_RAD])


def unscaled(numbers: Float64Array) -> Float64Array:
    """The displacement (4,) with the Jacobian's coordinates (3,) [m]."""
    return np.array([numbers[0], numbers[1], 0.0, numbers[2] * _PROBE_RAD / _PROBE_M])


def corrected(model_jacobian: Float64Array, done: Sequence[Correction], now_world: Float64Array) -> Float64Array:
    """The Jacobian (2 M, 3), updated with the observed effects of earlier corrections.

    `now_world` (M, 3) [m] is the predicted shape if the DLO were released now. After a correction u that was to change
    the shape by p and changed it by q, the update is (q - p) uᵀ / uᵀu; of q - p no more than `TRUST` of p counts.
    """
    matrix = model_jacobian.copy()
    after = [*(correction.released_world for correction in done), now_world][1:]
    for correction, seen in zip(done, after, strict=True):
        u = scaled(correction.displacement)
        predicted = (correction.predicted_world - correction.released_world)[:, :2].ravel()
        surprise = (seen - correction.predicted_world)[:, :2].ravel()
        allowed = TRUST * float(np.linalg.norm(predicted))
        surprise *= min(1.0, allowed / max(float(np.linalg.norm(surprise)), 1e-9))
        matrix += np.outer(surprise, u) / max(float(u @ u), 1e-8)
    return matrix


def damped_step(matrix: Float64Array, error: Float64Array) -> Float64Array:
    """The displacement (4,) of damped least squares that reduces an error (M, 2) [m], within the limits."""
    # As RMS over the nodes per length of the tool, so that the damping does not depend on their number.
    nodes = len(error)
    normal = matrix.T @ matrix / nodes + (_DAMPING_M / _PROBE_M) ** 2 * np.eye(3) * 0.25
    numbers = np.linalg.solve(normal, matrix.T @ error.ravel() / nodes)
    displacement = unscaled(np.asarray(numbers, dtype=np.float64))
    far = max(float(np.linalg.norm(displacement[:2])) / LARGEST_M, abs(float(displacement[3])) / LARGEST_RAD)
    return displacement / max(far, 1.0)


LEAST_GAIN_M = 0.001
"""Smallest expected gain of a correction [m RMSE]."""
LEAST_SDS = 1.0
"""Smallest expected gain of a correction, in standard deviations of the gain by the shape's covariance."""
_GOOD_FRACTION = 0.5  # fraction of the threshold at which control ends: the view behind the arm is not exact
_WINDOW = 2  # corrections without progress after which control is in a deadlock
_SLACK_FRACTION = 0.02  # relative slack of the DLO between two held nodes, so that a correction never stretches it
_HIDDEN = 3.0  # factor on the standard deviation of a hidden node, measured behind the hand


@dataclass(frozen=True, kw_only=True)
class ServoConfig:
    """Required quality of the observation for corrections while the DLO is held."""

    sight_m: Positive = 0.003
    """Accuracy of the observation of a held DLO, if the observer gives none: standard deviation of each node along
    each axis [m]. Larger: fewer corrections, of larger errors."""
    least_health: Fraction = 0.9
    """Least health of the observation, 0 (lost) to 1, at which a correction is made. Larger: fewer corrections."""

    def __post_init__(self) -> None:
        check_ranges(self, "planning.servo")


@dataclass(frozen=True)
class Gain:
    """What a correction is expected to gain."""

    rmse_m: float
    """Less RMSE [m]."""
    square_m2: float
    """Less mean square [m²]."""
    sd_m2: float
    """Standard deviation of that [m²]."""

    def exceeds(self, sds: float, least_m: float) -> bool:
        """Whether the gain is at least `least_m` (RMSE) [m] and more than `sds` standard deviations."""
        return self.rmse_m >= least_m and self.square_m2 > sds * self.sd_m2


def gain(error: Float64Array, by: Float64Array, covariance: Float64Array) -> Gain:
    """Gain of moving nodes with `error` (M, 2) [m] and `covariance` (M, 2, 2) [m²] by `by` (M, 2) [m]."""
    before, after = _mean_square(error), _mean_square(error - by)
    variance = np.einsum("ni,nij,nj->n", by, covariance, by)
    return Gain(
        rmse_m=float(np.sqrt(before) - np.sqrt(after)),
        square_m2=before - after,
        sd_m2=2.0 * float(np.mean(np.sqrt(np.maximum(variance, 0.0)))),
    )


def usual(sd_m: float, visible: BoolArray) -> Float64Array:
    """Covariance (M, 2, 2) [m²] of nodes with `sd_m` [m] along each axis, larger for nodes that are not `visible`."""
    return (np.where(visible, sd_m, _HIDDEN * sd_m) ** 2)[:, None, None] * np.eye(2)


def _mean_square(error: Float64Array) -> float:
    return float(np.mean(np.sum(error**2, axis=1)))


_FRACTIONS = (1.0, 0.5, 0.25)  # fractions of the step that are tried: the response of a slipping rod is nonlinear


@dataclass(frozen=True, kw_only=True)
class HeldRod:
    """The held rod, its goal, and the corrections so far."""

    shape: DloState
    goal_world: Float64Array  # (M, 3) [m] in the order of the rod
    grip: GraspedNode
    others: tuple[GraspedNode, ...]
    """Nodes that other robots hold."""
    done: tuple[Correction, ...]
    """Corrections since the grasp, the first one first."""


def advise(
    held: HeldRod,
    threshold_m: float,
    model: BelievedDlo,
    reachable: Reachable,
    config: ServoConfig,
    posts: Float64Array = NO_POSTS,
    room: HandRoom | None = None,
) -> ControlAdvice:
    """The next correction among posts (P, 8), where the hand has `room`, or the verdict that ends control."""
    grip = Grip(held.grip.node, _tool(held.grip.T_world_tcp))
    nodes = held.shape.nodes_world
    shapes = released(model, nodes, grip, probes(), posts)
    now = shapes[0]
    rmse_m = geometry.rmse_m(now, held.goal_world)

    def ends(verdict: ControlVerdict, reason: str) -> ControlAdvice:
        return ControlAdvice(
            verdict=verdict, reason=reason, rmse_m=rmse_m, then_rmse_m=rmse_m, target=held.grip.T_world_tcp
        )

    if rmse_m < _GOOD_FRACTION * threshold_m:
        return ends(ControlVerdict.SETTLED, "good_enough")
    if held.shape.health < config.least_health:
        return ends(ControlVerdict.SETTLED, "badly_seen")
    if _no_progress(held, rmse_m):
        return ends(ControlVerdict.DEADLOCK, "no_progress")
    matrix = corrected(jacobian(shapes), held.done, now)
    step = damped_step(matrix, (held.goal_world - now)[:, :2])
    steps = [fraction * step for fraction in _FRACTIONS]
    allowed = [by for by in steps if not _overstretches(held, grip, by, model)]
    if not allowed:
        return ends(ControlVerdict.DEADLOCK, "overstretch")
    reached = [by for by in allowed if reachable(_pose(grip.tool + by))]
    if not reached:
        return ends(ControlVerdict.DEADLOCK, "out_of_reach")
    free = [by for by in reached if room is None or room.held_along(np.stack((grip.tool, grip.tool + by)))]
    if not free:
        return ends(ControlVerdict.DEADLOCK, "no_room")
    expected = released(model, nodes, grip, free, posts)
    left_m = [geometry.rmse_m(shape, held.goal_world) for shape in expected]
    best = int(np.argmin(left_m))
    if left_m[best] > rmse_m - LEAST_GAIN_M:
        return ends(ControlVerdict.SETTLED, "no_gain")
    if not _gain(held, now, expected[best], config).exceeds(LEAST_SDS, LEAST_GAIN_M):
        return ends(ControlVerdict.SETTLED, "in_doubt")
    return ControlAdvice(
        verdict=ControlVerdict.CORRECT,
        reason="",
        rmse_m=rmse_m,
        then_rmse_m=left_m[best],
        target=_pose(grip.tool + free[best]),
        correction=Correction(displacement=free[best], released_world=now, predicted_world=expected[best]),
    )


def _gain(held: HeldRod, now: Float64Array, then: Float64Array, config: ServoConfig) -> Gain:
    """Gain of a correction from one released shape (M, 3) [m] to another, with its uncertainty."""
    shape = held.shape
    if shape.covariance is not None:
        covariance = shape.covariance[:, :2, :2]
    else:
        covariance = usual(config.sight_m, np.ones(len(now), np.bool_) if shape.visible is None else shape.visible)
    return gain((held.goal_world - now)[:, :2], (then - now)[:, :2], covariance)


def _no_progress(held: HeldRod, rmse_m: float) -> bool:
    """Whether the last `_WINDOW` corrections brought no new best error."""
    if len(held.done) < _WINDOW:
        return False
    errors = [geometry.rmse_m(correction.released_world, held.goal_world) for correction in held.done] + [rmse_m]
    return min(errors[-_WINDOW:]) > min(errors[:-_WINDOW]) - LEAST_GAIN_M


def _overstretches(held: HeldRod, grip: Grip, by: Float64Array, model: BelievedDlo) -> bool:
    """Whether the tool would be farther from another held node than the length of DLO between them."""
    edge_m = model.length_m / (model.nodes - 1)
    there = grip.tool + by
    return any(
        float(np.linalg.norm(there[:3] - other.T_world_tcp.position_m))
        > (1.0 - _SLACK_FRACTION) * abs(other.node - grip.node) * edge_m
        for other in held.others
    )


def _tool(pose: Pose) -> Float64Array:
    T = geometry.matrix(pose)
    return np.array([*pose.position_m, np.arctan2(T[1, 0], T[0, 0])])


def _pose(tool: Float64Array) -> Pose:
    return geometry.downward(tool[:3], float(tool[3]))


def foresee(
    model: BelievedDlo,
    nodes_world: Float64Array,
    goal_world: Float64Array,
    action: Action,
    prediction_error_m: float,
    config: ServoConfig,
    posts: Float64Array = NO_POSTS,
) -> ControlForecast:
    """Whether control should follow `action` on a rod at `nodes_world` (M, 3) [m] with the goal `goal_world`.

    `prediction_error_m` is the prediction error of earlier actions (RMS) [m], a lower bound of the uncertainty.
    `posts` (P, 8) are from `Scene.posts_world`.
    """
    if not action.facts.corrected:
        return ControlForecast(follows=False, gain_m=0.0)
    motion = Motion(node=action.grasp.node, waypoints=waypoints_of(action), velocity=action.velocity)
    rods = (PlanningRod(), *rods_around(UNCERTAINTY, UNCERTAINTY))
    shapes = simulate(model, nodes_world, rods, (motion,), TIMESTEP_S, posts=posts).nodes_world[:, 0]
    expected, others = shapes[0], shapes[1:]
    spread_m = float(np.sqrt(np.mean(np.sum((others - expected) ** 2, axis=-1))))
    others = expected + max(1.0, prediction_error_m / max(spread_m, 1e-6)) * (others - expected)
    grip = Grip(motion.node, motion.waypoints[-1])
    matrix = jacobian(released(model, expected, grip, probes(), posts))
    gains_m = [_correctable_m(matrix, (goal_world - shape)[:, :2], config.sight_m) for shape in others]
    gain_m = float(np.mean(gains_m))
    return ControlForecast(follows=gain_m >= LEAST_GAIN_M, gain_m=gain_m)


def _correctable_m(matrix: Float64Array, error: Float64Array, sight_m: float) -> float:
    """RMSE [m] that a correction would remove from an error (M, 2) [m]; 0 if it is within the accuracy `sight_m`."""
    by = (matrix @ scaled(damped_step(matrix, error))).reshape(-1, 2)
    expected = gain(error, by, usual(sight_m, np.ones(len(error), dtype=np.bool_)))
    return expected.rmse_m if expected.exceeds(LEAST_SDS, LEAST_GAIN_M) else 0.0
