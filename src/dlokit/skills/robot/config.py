"""Settings of the robot skills."""

import math
from dataclasses import dataclass, field

from dlokit.description.table import Surroundings
from dlokit.errors import ConfigError
from dlokit.types.robot import LEASE_S


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """How the robot moves and what it keeps clear of."""

    state_rate_hz: float = 50.0
    """Rate at which the robot's state is published [Hz]."""
    commander_lease_s: float = LEASE_S
    """Time without a sign of life from the decision process after which the arm brakes [s of the machine's clock]: it
    was killed, or is frozen."""
    driver_lease_s: float = LEASE_S
    """Time without a sign of life from the driver's process after which the arm itself brakes [s]."""
    loop_silent_s: float = 1.0
    """An event loop of one of the two that has hung for so long [s] gives no more signs of life."""
    surroundings: Surroundings = field(default_factory=Surroundings)
    """What the arm must keep clear of."""

    def __post_init__(self) -> None:
        for name, value in (
            ("commander-lease", self.commander_lease_s),
            ("driver-lease", self.driver_lease_s),
            ("loop-silent", self.loop_silent_s),
        ):
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"--robot.{name}-s is {value}; it must be a number of seconds above 0.")
