"""How much differs from run to run. Everything is off unless it is asked for."""

import math
from dataclasses import dataclass, fields

from dlokit.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Randomisation:
    """How far each property of the cell is drawn from its nominal value; 0 switches a factor off.

    A share of 0.25 draws a factor between 1/1.25 and 1.25, either side alike.
    """

    friction: float = 0.0
    """Share by which the friction of the table may differ."""
    friction_regions: float = 0.0
    """Share by which each quarter of the table may differ from the others in friction."""
    stiffness: float = 0.0
    """Share by which the DLO's bending stiffness may differ."""
    weight: float = 0.0
    """Share by which the DLO's mass per length may differ."""
    curl_1_m: float = 0.0
    """Largest curvature that the DLO may have without load [1/m], to either side."""
    hand_eye_from_m: float = 0.0
    """Smallest distance of the believed camera position from the true one [m]."""
    hand_eye_to_m: float = 0.0
    """Largest such distance [m]; 0 leaves what `cell.camera_error_m` says."""
    table_tilt_deg: float = 0.0
    """Largest tilt of the table about each of its axes [°]."""
    light: float = 0.0
    """Share by which the light may differ."""
    color: float = 0.0
    """Most by which each colour channel of the DLO may differ, of 1."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value: float = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"cell.randomisation.{field.name} is {value}; it must be 0 or more.")
        if self.hand_eye_to_m < self.hand_eye_from_m:
            raise ConfigError(
                f"cell.randomisation.hand_eye_to_m is {self.hand_eye_to_m}, less than hand_eye_from_m "
                f"({self.hand_eye_from_m}); exchange them."
            )


RANDOMISED = Randomisation(
    friction=0.25,
    friction_regions=0.15,
    stiffness=0.5,
    weight=0.2,
    curl_1_m=0.5,
    hand_eye_from_m=0.002,
    hand_eye_to_m=0.005,
    table_tilt_deg=0.2,
    light=0.15,
    color=0.1,
)
"""What a bench randomises. The table's tilt is that of a frame set up with a spirit level; friction and stiffness
scatter as much as between two ropes of one kind."""
