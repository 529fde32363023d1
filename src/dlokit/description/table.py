"""The table: where on it a DLO may lie, and how far arms keep clear of it and of one another."""

from dataclasses import dataclass

TABLE_X_M = (0.30, 0.75)
"""Part of the table that arm and camera share, along x [m]."""
TABLE_Y_M = (-0.35, 0.35)
"""The same along y [m]."""


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What the arm must keep clear of."""

    table_height_m: float = 0.0
    """Height of the table top [m]."""
    table_clearance_m: float = 0.001
    """Smallest distance of any part of the arm from the table [m]; fingertips grasp 2 mm above it."""
    arm_clearance_m: float = 0.01
    """Smallest distance from another arm of the cell [m]; the capsules already stand off the surface."""
    self_clearance_m: float = 0.0
    """Smallest distance between parts of the arm [m]; their capsules already stand off the surface."""
    collision_step_rad: float = 0.03
    """Largest joint angle between two configurations that are checked for collisions [rad]."""
