"""Sensitivity of the shape after a release to small motions of the tool before it.

The Jacobian is computed by finite differences with the planning rod, which is dragged, released, and comes to rest.
Broyden's rank-one updates add the effects of earlier corrections that the camera has observed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import Motion, PlanningRod, play
from dlokit.types.action import Correction, VelocityProfile
from dlokit.types.arrays import Float64Array

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
_DAMPING_M = 0.003  # a direction that moves the nodes by less than this (RMS) per `_PROBE_M` is hardly used


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
) -> Float64Array:
    """The shapes (C, M, 3) [m] of a held rod (M, 3) at rest, released after each displacement (4,)."""
    motions = tuple(
        Motion(node=grip.node, waypoints=np.stack((grip.tool, grip.tool + by)), velocity=VELOCITY)
        for by in displacements
    )
    return play(model, nodes_world, (PlanningRod(),), motions, TIMESTEP_S).nodes_world[0]


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
