"""How the shape after a release answers to small motions of the tool before it, and the settings of shape servoing.

The model's answer is a matrix of finite differences, played through in the quick rod: the rod is dragged, let go, and
comes to rest. What the camera saw of earlier corrections goes into it as rank-one updates (Broyden's).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit.errors import ConfigError
from dlokit.rod.believed import ModelConfig
from dlokit.rod.rollout import Motion, QuickRod, play
from dlokit.types.action import Correction, VelocityProfile
from dlokit.types.arrays import Float64Array

STILL = np.zeros(4)
_ACCELERATION_M_S2, _JERK_M_S3 = 1.0, 10.0


@dataclass(frozen=True, kw_only=True)
class ServoConfig:
    """How the error that is left is reduced while the DLO is held."""

    good_share: float = 0.5
    """Good enough is this share of the threshold: what the camera sees behind the arm is not exact."""
    least_gain_m: float = 0.001
    """A correction that is expected to gain less than this RMSE [m] is not worth its time."""
    window: int = 2
    """Corrections in a row that may go by without progress; then control is in a deadlock."""
    probe_m: float = 0.008
    """Displacement of the tool that the Jacobian is taken with [m]: enough to break friction."""
    probe_rad: float = 0.15
    """Turn of the tool that it is taken with [rad]."""
    largest_m: float = 0.03
    """Longest correction [m]."""
    largest_rad: float = 0.5
    """Largest turn of one correction [rad]."""
    damping_m: float = 0.003
    """Damping of the least squares: a direction that moves the nodes by less than this (RMS) per `probe_m` is hardly
    used [m]."""
    trust: float = 0.5
    """How much of what the last corrections did otherwise than predicted goes into the Jacobian, against the
    prediction; more is cut off."""
    doubts: float = 1.0
    """A correction gains more than so many standard deviations of what the shape's covariance lets it seem to gain."""
    sight_m: float = 0.003
    """How exactly a held DLO is seen, where the observer does not say, and before it is held: standard deviation of
    each node along each axis [m]."""
    doubt: float = 1.4
    """Before an action: factor by which friction and stiffness of the DLO may be other than believed, up or down; what
    control could mend of that decides whether it follows."""
    least_health: float = 0.9
    """The observer's trust that is needed for one."""
    slack_share: float = 0.02
    """Two held nodes may be no farther apart than the DLO between them less this share: more would overstretch it."""
    speed_m_s: float = 0.1
    """Speed of the tool on a correction [m/s]."""
    timestep_s: float = 0.005
    """Step of the quick rod [s]."""

    def __post_init__(self) -> None:
        if self.window < 1:
            raise ConfigError(f"--planning.servo.window is {self.window}; it must be 1 or more.")
        if not (math.isfinite(self.doubt) and self.doubt >= 1.0):
            raise ConfigError(f"--planning.servo.doubt is {self.doubt}; it is a factor of 1 or more.")
        for name in ("probe_m", "probe_rad", "largest_m", "largest_rad", "speed_m_s", "timestep_s"):
            value: float = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"--planning.servo.{name.replace('_', '-')} is {value}; it must be above 0.")
        if self.timestep_s > 0.02:
            raise ConfigError(f"--planning.servo.timestep-s is {self.timestep_s}; up to 0.02 s is allowed.")


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
