"""The path from the grasp to the goal position: lift, carry, lower, release."""

import math

import numpy as np

from dlokit import geometry
from dlokit.skills.planning.actions import PathConfig
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose


def carry_path(
    start_world: Float64Array, end_world: Float64Array, yaw_rad: float, turn_rad: float, config: PathConfig
) -> tuple[Pose, ...]:
    """Tool poses from above `start_world` (3,) [m] down to `end_world` (3,) [m], turning by `turn_rad` on the carry."""
    lift = np.array([0.0, 0.0, config.lift_m])
    beyond = end_world + config.overshoot * (end_world - start_world)
    beyond[2] = end_world[2]
    distance = float(np.linalg.norm(beyond - start_world))
    # Poses are at most 0.3 rad apart, so that nobody turns the short way round where the long one is meant.
    count = max(1, math.ceil(distance / config.spacing_m), math.ceil(abs(turn_rad) / 0.3))
    carry = [
        geometry.downward(start_world + share * (beyond - start_world) + lift, yaw_rad + share * turn_rad)
        for share in np.linspace(0.0, 1.0, count + 1)
    ]
    return (*carry, geometry.downward(beyond, yaw_rad + turn_rad))


def velocity(config: PathConfig) -> VelocityProfile:
    """How fast the tool moves along the path."""
    return VelocityProfile(
        speed_m_s=config.speed_m_s, acceleration_m_s2=config.acceleration_m_s2, jerk_m_s3=config.jerk_m_s3
    )
