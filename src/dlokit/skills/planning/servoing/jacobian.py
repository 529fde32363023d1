"""How the shape after a release answers to small motions of the tool before it.

The model's answer is a matrix of finite differences, played through in the quick rod: the rod is dragged, let go, and
comes to rest. What the camera saw of earlier corrections goes into it as rank-one updates (Broyden's).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit.rod.believed import ModelConfig
from dlokit.rod.rollout import Motion, QuickRod, play
from dlokit.skills.planning.servoing.config import ServoConfig
from dlokit.types.action import Correction, VelocityProfile
from dlokit.types.arrays import Float64Array

STILL = np.zeros(4)
_ACCELERATION_M_S2, _JERK_M_S3 = 1.0, 10.0


@dataclass(frozen=True)
class Grip:
    """A held node and the tool that holds it."""

    node: int
    tool: Float64Array  # (4,) x, y, z [m], yaw [rad]


def velocity(config: ServoConfig) -> VelocityProfile:
    """How fast the tool moves on a correction."""
    return VelocityProfile(speed_m_s=config.speed_m_s, acceleration_m_s2=_ACCELERATION_M_S2, jerk_m_s3=_JERK_M_S3)


def released(
    model: ModelConfig,
    nodes_world: Float64Array,
    grip: Grip,
    displacements: Sequence[Float64Array],
    config: ServoConfig,
) -> Float64Array:
    """The shapes (C, M, 3) [m] in which a held rod (M, 3) would come to rest, let go after each displacement (4,)."""
    motions = tuple(
        Motion(node=grip.node, waypoints=np.stack((grip.tool, grip.tool + by)), velocity=velocity(config))
        for by in displacements
    )
    return play(model, nodes_world, (QuickRod(),), motions, config.timestep_s).nodes_world[0]


def probes(config: ServoConfig) -> list[Float64Array]:
    """The displacements that the Jacobian needs: none, then both ways along x, y and about z."""
    steps = np.diag([config.probe_m, config.probe_m, 0.0, config.probe_rad])
    return [STILL, *(sign * steps[axis] for axis in (0, 1, 3) for sign in (1.0, -1.0))]


def jacobian(shapes: Float64Array, config: ServoConfig) -> Float64Array:
    """The Jacobian (2 M, 3) of the nodes' x, y by the tool's x, y and turn, from the shapes (7, M, 3) [m] of `probes`.

    A turn counts in lengths, `probe_rad` as `probe_m`, so that all columns have one unit.
    """
    flat = shapes[:, :, :2].reshape(len(shapes), -1)
    return (flat[1::2] - flat[2::2]).T / (2.0 * config.probe_m)


def scaled(displacement: Float64Array, config: ServoConfig) -> Float64Array:
    """The numbers (3,) [m] that the Jacobian takes for a displacement (4,)."""
    return np.array([displacement[0], displacement[1], displacement[3] * config.probe_m / config.probe_rad])


def unscaled(numbers: Float64Array, config: ServoConfig) -> Float64Array:
    """The displacement (4,) that numbers (3,) [m] stand for."""
    return np.array([numbers[0], numbers[1], 0.0, numbers[2] * config.probe_rad / config.probe_m])


def corrected(
    model_jacobian: Float64Array, done: Sequence[Correction], now_world: Float64Array, config: ServoConfig
) -> Float64Array:
    """The Jacobian (2 M, 3) with what earlier corrections did, seen by the camera, put in.

    `now_world` (M, 3) [m] is the shape expected if the DLO were let go now. After a correction u that was to change
    the shape by p and changed it by q, the update is (q - p) uᵀ / uᵀu; of q - p no more than `trust` of p counts.
    """
    matrix = model_jacobian.copy()
    after = [*(correction.released_world for correction in done), now_world][1:]
    for correction, seen in zip(done, after, strict=True):
        u = scaled(correction.displacement, config)
        predicted = (correction.predicted_world - correction.released_world)[:, :2].ravel()
        surprise = (seen - correction.predicted_world)[:, :2].ravel()
        allowed = config.trust * float(np.linalg.norm(predicted))
        surprise *= min(1.0, allowed / max(float(np.linalg.norm(surprise)), 1e-9))
        matrix += np.outer(surprise, u) / max(float(u @ u), 1e-8)
    return matrix


def damped_step(matrix: Float64Array, error: Float64Array, config: ServoConfig) -> Float64Array:
    """The displacement (4,) of damped least squares that reduces an error (M, 2) [m], within the limits."""
    # As RMS over the nodes per length of the tool, so that the damping does not depend on their number.
    nodes = len(error)
    normal = matrix.T @ matrix / nodes + (config.damping_m / config.probe_m) ** 2 * np.eye(3) * 0.25
    numbers = np.linalg.solve(normal, matrix.T @ error.ravel() / nodes)
    displacement = unscaled(np.asarray(numbers, dtype=np.float64), config)
    far = max(
        float(np.linalg.norm(displacement[:2])) / config.largest_m, abs(float(displacement[3])) / config.largest_rad
    )
    return displacement / max(far, 1.0)
