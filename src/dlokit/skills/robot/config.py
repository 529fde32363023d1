"""Settings of the robot skills."""

import math
from dataclasses import dataclass, field

from dlokit.errors import ConfigError
from dlokit.skills.robot.checks import Surroundings


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """How the robot moves and what it keeps clear of."""

    state_rate_hz: float = 50.0
    """Rate at which the robot's state is published [Hz]."""
    commander_lease_s: float = 1.0
    """Time without a sign of life from a decision process that is frozen after which the arm brakes [s of the machine's
    clock]; one that dies is noticed at once. Signs of life of a machine that is overloaded have gaps of 0.2 s."""
    driver_lease_s: float = 0.5
    """Time without a sign of life from the driver after which the arm brakes [s]."""
    watch_period_s: float = 0.02
    """How often a lease that was taken is looked at [s], on the machine's clock."""
    surroundings: Surroundings = field(default_factory=Surroundings)
    """What the arm must keep clear of."""

    def __post_init__(self) -> None:
        for name, value in (("commander", self.commander_lease_s), ("driver", self.driver_lease_s)):
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"--robot.{name}-lease-s is {value}; it must be a number of seconds above 0.")
