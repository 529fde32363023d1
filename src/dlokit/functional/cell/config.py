"""Settings of the cell."""

import math
from dataclasses import dataclass, field

from dlokit.description.dlo import SOFT_ROPE, DloPreset
from dlokit.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class CellConfig:
    """The simulated cell: what lies on the table, and how well it is seen."""

    dlo: DloPreset = field(default_factory=lambda: SOFT_ROPE)
    """What lies on the table."""
    nodes: int = 41
    """Nodes of the cell's rod; the system's own model has another number."""
    timestep_s: float = 0.0025
    """Step of the physics [s]; a whole number of them makes one tick of 10 ms."""
    table_friction: float = 0.5
    """Friction of the table; with the DLO's, the larger counts."""
    settle_s: float = 2.0
    """Time the DLO is given to come to rest before the run starts [s]."""
    width_px: int = 640
    """Width of each picture [px]; the focal length scales with it."""
    height_px: int = 560
    """Height of each picture [px]."""
    samples: int = 0
    """Samples a pixel against jagged edges: 0, 2, 4 or 8; 4 doubles to quadruples the time of software rendering."""
    image_noise_sigma: float = 1.5
    """Standard deviation of the noise of each pixel [grey levels of 255]."""
    camera_error_m: float = 0.003
    """How far the believed camera position is from the true one [m]."""
    camera_error_deg: float = 0.2
    """How far the believed camera orientation is from the true one [°]."""
    shadows: bool = False
    """Whether the arm casts shadows; costs several times the rendering."""
    real_time_factor: float = 1.0
    """Fastest pace of the cell's clock when live: cell seconds a machine second. Lockstep does not look at it."""

    def __post_init__(self) -> None:
        steps = TICK_S / self.timestep_s if self.timestep_s > 0.0 else 0.0
        if not (steps >= 1.0 and math.isclose(steps, round(steps), rel_tol=1e-9)):
            raise ConfigError(
                f"cell.timestep_s is {self.timestep_s}; {TICK_S} s must be a whole number of them, "
                "e.g. 0.002, 0.0025 or 0.005."
            )
        if self.width_px < 64 or self.height_px < 64:
            raise ConfigError(f"Pictures of {self.width_px}x{self.height_px} px are too small; use 64x64 or more.")
        if self.samples not in (0, 2, 4, 8):
            raise ConfigError(f"cell.samples is {self.samples}; use 0, 2, 4 or 8.")
        for name in ("settle_s", "image_noise_sigma", "camera_error_m", "camera_error_deg", "table_friction"):
            value: float = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"cell.{name} is {value}; it must be 0 or more.")
        if not self.real_time_factor > 0.0:
            raise ConfigError(f"cell.real_time_factor is {self.real_time_factor}; it must be above 0.")

    @property
    def steps_per_tick(self) -> int:
        """Physics steps in one tick."""
        return round(TICK_S / self.timestep_s)


TICK_S = 0.01
"""Grid of the cell's time [s]: the physics runs, and the clock is told, in these."""
