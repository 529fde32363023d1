"""The table: where on it a DLO may lie, and how far arms keep clear of it and of one another."""

import math
from dataclasses import dataclass

from dlokit.errors import ConfigError

TABLE_X_M = (0.30, 0.75)
"""Part of the table that arm and camera share, along x [m]."""
TABLE_Y_M = (-0.35, 0.35)
"""The same along y [m]."""
TABLE_TOP_M = 0.0
"""Height of its top in the world [m], by definition: shapes lie a radius above z = 0."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table, by what a ruler tells of it; its top is at z = 0 of the world."""

    centre_m: tuple[float, float] = (0.45, 0.0)
    """Middle of its top (x, y) in the world [m]."""
    size_m: tuple[float, float] = (1.5, 1.4)
    """Its extent along x and y [m]."""
    thickness_m: float = 0.05
    """Thickness of its top [m]; nothing but pictures shows it."""

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in self.centre_m):
            raise ConfigError(f"table.centre_m is {self.centre_m}; it must be two numbers in metres.")
        if not all(0.0 < value < math.inf for value in (*self.size_m, self.thickness_m)):
            raise ConfigError(f"table.size_m is {self.size_m} and thickness_m {self.thickness_m}; all must be above 0.")

    @property
    def half_size_m(self) -> tuple[float, float]:
        """Half its extent along x and y [m]."""
        return self.size_m[0] / 2.0, self.size_m[1] / 2.0


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What the arm must keep clear of."""

    table_clearance_m: float = 0.001
    """Smallest distance of any part of the arm from the table [m]; fingertips grasp 2 mm above it."""
    arm_clearance_m: float = 0.01
    """Smallest distance from another arm of the cell [m]; the capsules already stand off the surface."""
    self_clearance_m: float = 0.0
    """Smallest distance between parts of the arm [m]; their capsules already stand off the surface."""
    collision_step_rad: float = 0.03
    """Largest joint angle between two configurations that are checked for collisions [rad]."""
