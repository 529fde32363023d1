"""The table: its pose and size, its usable part, and the contact parameters of bodies on it in MuJoCo."""

from dataclasses import dataclass

from dlokit.ranges import Positive, check_ranges

TABLE_X_M = (0.30, 0.75)
"""Part of the table within reach of the arm and in view of the camera, along x [m]."""
TABLE_Y_M = (-0.35, 0.35)
"""The same along y [m]."""
TABLE_TOP_M = 0.0
"""Height of its top in the world [m], by definition: the centre line of a DLO on it is one radius above z = 0."""
TABLE_THICKNESS_M = 0.05
"""Thickness of its top [m], visible only in pictures."""

WORLD_BIT = 1
"""Collision group of the table, the rod and all further bodies."""
ROBOT_BIT = 2
"""Collision group of a robot's shapes, which collide with the world but not with each other: they overlap at joints."""
LINK_BIT = 4
"""Collision group of a chain's links, which collide with each other and the robot; small feet touch the table."""

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
