"""Settings of the robot skills."""

from dataclasses import dataclass

from dlokit.ranges import NotNegative, Positive, check_ranges
from dlokit.types.robot import LEASE_S


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """Time limits for an arm's motion without heartbeats, and its distance from other arms."""

    commander_lease_s: Positive = LEASE_S
    """Time without a heartbeat of the decision process after which the arm brakes [s of the machine's clock]: the
    process was killed, or is frozen. Larger: fewer stops on a busy machine, later ones after a failure."""
    driver_lease_s: Positive = LEASE_S
    """Time without a heartbeat of the driver's process after which the arm brakes on its own [s]. Larger: as above."""
    arm_clearance_m: NotNegative = 0.01
    """Smallest distance from another arm of the cell [m], between the capsules around the links."""

    def __post_init__(self) -> None:
        check_ranges(self, "robot")
