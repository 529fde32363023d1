"""The table: its place and size, and where on it a DLO may lie."""

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
