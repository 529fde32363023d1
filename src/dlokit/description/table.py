"""The table: its place and size, where on it a DLO may lie, and how bodies touch it and one another in MuJoCo."""

from dataclasses import dataclass

from dlokit.ranges import Positive, check_ranges

TABLE_X_M = (0.30, 0.75)
"""Part of the table within reach of the arm and in view of the camera, along x [m]."""
TABLE_Y_M = (-0.35, 0.35)
"""The same along y [m]."""
TABLE_TOP_M = 0.0
"""Height of its top in the world [m], by definition: shapes lie a radius above z = 0."""
TABLE_THICKNESS_M = 0.05
"""Thickness of its top [m]; it shows in pictures alone."""

WORLD_BIT = 1
"""Table, rod, and whatever else there is."""
ROBOT_BIT = 2
"""A robot's shapes meet the world but not one another: they overlap at the joints."""
LINK_BIT = 4
"""Links of a chain meet one another and the robot; on the table they stand on feet."""

CONTACT_SOLREF = (0.004, 1.0)
"""Time constant [s] and damping ratio of contacts that do not creep, common to table, rod and pads."""
CONTACT_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Impedance of contacts that do not creep: static friction creeps with ``1 - solimp[0]``."""
ROLLING_M = 0.001
"""Resistance to rolling and turning on the spot [m]: without it a released rod rolls away like a steel bar."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """Dimensions of the table; its top is at z = 0 of the world."""

    centre_m: tuple[float, float] = (0.45, 0.0)
    """Middle of its top (x, y) in the world [m]."""
    size_m: tuple[Positive, Positive] = (1.5, 1.4)
    """Its extent along x and y [m]."""

    def __post_init__(self) -> None:
        check_ranges(self, "table")

    @property
    def half_size_m(self) -> tuple[float, float]:
        """Half its extent along x and y [m]."""
        return self.size_m[0] / 2.0, self.size_m[1] / 2.0
