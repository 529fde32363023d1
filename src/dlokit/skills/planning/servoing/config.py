"""Settings of shape servoing."""

import math
from dataclasses import dataclass

from dlokit.errors import ConfigError


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
