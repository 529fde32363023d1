"""Settings of the robot skills."""

from dataclasses import dataclass, field

from dlokit.skills.robot.checks import Surroundings


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """How the robot moves and what it keeps clear of."""

    state_rate_hz: float = 50.0
    """Rate at which the robot's state is published [Hz]."""
    driver_lease_s: float = 0.5
    """Time without a sign of life from the driver after which the arm brakes [s]."""
    watch_period_s: float = 0.02
    """How often a lease that was taken is looked at [s], on the machine's clock."""
    surroundings: Surroundings = field(default_factory=Surroundings)
    """What the arm must keep clear of."""
