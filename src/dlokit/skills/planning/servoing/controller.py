"""The controller: computes one correction, or ends control with a reason (McConachie et al., IJRR 2020).

Each call uses the latest observation: the Jacobian at the current shape, the effects of earlier corrections, and the
correction with the smallest predicted error after the release, which is simulated first.

A correction moves node i by d_i; the error left at it is e_i, seen with covariance P_i. Its gain in mean square is
(1/M) Σ (2 e_i · d_i - |d_i|²), in which only the first term is seen. Neighbours err alike, so the standard deviations
of that term add up: (2/M) Σ sqrt(d_iᵀ P_i d_i).
"""

from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.ranges import Fraction, Positive, check_ranges
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.base import Reachable
from dlokit.skills.planning.servoing.jacobian import (
    Grip,
    corrected,
    damped_step,
    jacobian,
    probes,
    released,
)
from dlokit.types.action import ControlAdvice, ControlVerdict, Correction, GraspedNode
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.pose import Pose

LEAST_GAIN_M = 0.001
"""Smallest expected gain of a correction [m RMSE]."""
DOUBTS = 1.0
"""Smallest expected gain of a correction, in standard deviations of the gain by the shape's covariance."""
_GOOD_SHARE = 0.5  # fraction of the threshold at which control ends: the view behind the arm is not exact
_WINDOW = 2  # corrections without progress after which control is in a deadlock
_SLACK_SHARE = 0.02  # relative slack of the DLO between two held nodes, so that a correction never stretches it
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
    doubt_m2: float
    """Standard deviation of that [m²]."""

    def exceeds(self, doubts: float, least_m: float) -> bool:
        """Whether the gain is at least `least_m` (RMSE) [m], and significant."""
        return self.rmse_m >= least_m and self.square_m2 > doubts * self.doubt_m2


def gain(error: Float64Array, by: Float64Array, covariance: Float64Array) -> Gain:
    """Gain of moving nodes with `error` (M, 2) [m] and `covariance` (M, 2, 2) [m²] by `by` (M, 2) [m]."""
    before, after = _mean_square(error), _mean_square(error - by)
    variance = np.einsum("ni,nij,nj->n", by, covariance, by)
    return Gain(
        rmse_m=float(np.sqrt(before) - np.sqrt(after)),
        square_m2=before - after,
        doubt_m2=2.0 * float(np.mean(np.sqrt(np.maximum(variance, 0.0)))),
    )


def usual(sd_m: float, visible: BoolArray) -> Float64Array:
    """Covariance (M, 2, 2) [m²] of nodes with `sd_m` [m] along each axis, larger for nodes that are not `visible`."""
    return (np.where(visible, sd_m, _HIDDEN * sd_m) ** 2)[:, None, None] * np.eye(2)


def _mean_square(error: Float64Array) -> float:
    return float(np.mean(np.sum(error**2, axis=1)))


_SHARES = (1.0, 0.5, 0.25)  # fractions of the step that are tried: the response of a slipping rod is nonlinear


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
    held: HeldRod, threshold_m: float, model: BelievedDlo, reachable: Reachable, config: ServoConfig
) -> ControlAdvice:
    """The next correction, or the verdict that ends control."""
    grip = Grip(held.grip.node, _tool(held.grip.T_world_tcp))
    nodes = held.shape.nodes_world
    shapes = released(model, nodes, grip, probes())
    now = shapes[0]
    rmse_m = geometry.rmse_m(now, held.goal_world)

    def ends(verdict: ControlVerdict, reason: str) -> ControlAdvice:
        return ControlAdvice(
            verdict=verdict, reason=reason, rmse_m=rmse_m, then_rmse_m=rmse_m, target=held.grip.T_world_tcp
        )

    if rmse_m < _GOOD_SHARE * threshold_m:
        return ends(ControlVerdict.SETTLED, "good_enough")
    if held.shape.health < config.least_health:
        return ends(ControlVerdict.SETTLED, "badly_seen")
    if _no_progress(held, rmse_m):
        return ends(ControlVerdict.DEADLOCK, "no_progress")
    matrix = corrected(jacobian(shapes), held.done, now)
    step = damped_step(matrix, (held.goal_world - now)[:, :2])
    steps = [share * step for share in _SHARES]
    allowed = [by for by in steps if not _overstretches(held, grip, by, model)]
    if not allowed:
        return ends(ControlVerdict.DEADLOCK, "overstretch")
    reached = [by for by in allowed if reachable(_pose(grip.tool + by))]
    if not reached:
        return ends(ControlVerdict.DEADLOCK, "out_of_reach")
    expected = released(model, nodes, grip, reached)
    left_m = [geometry.rmse_m(shape, held.goal_world) for shape in expected]
    best = int(np.argmin(left_m))
    if left_m[best] > rmse_m - LEAST_GAIN_M:
        return ends(ControlVerdict.SETTLED, "no_gain")
    if not _gain(held, now, expected[best], config).exceeds(DOUBTS, LEAST_GAIN_M):
        return ends(ControlVerdict.SETTLED, "in_doubt")
    return ControlAdvice(
        verdict=ControlVerdict.CORRECT,
        reason="",
        rmse_m=rmse_m,
        then_rmse_m=left_m[best],
        target=_pose(grip.tool + reached[best]),
        correction=Correction(displacement=reached[best], released_world=now, predicted_world=expected[best]),
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
        > (1.0 - _SLACK_SHARE) * abs(other.node - grip.node) * edge_m
        for other in held.others
    )


def _tool(pose: Pose) -> Float64Array:
    T = geometry.matrix(pose)
    return np.array([*pose.position_m, np.arctan2(T[1, 0], T[0, 0])])


def _pose(tool: Float64Array) -> Pose:
    return geometry.downward(tool[:3], float(tool[3]))
