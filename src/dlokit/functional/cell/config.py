"""Settings of the cell."""

import math
from dataclasses import dataclass, field

from dlokit.description.dlo import SOFT_ROPE, DloPreset
from dlokit.description.table import Table
from dlokit.errors import ConfigError
from dlokit.functional.cell.dlo_physics import DloPhysics, ElasticRod
from dlokit.functional.cell.randomisation import Randomisation


@dataclass(frozen=True, kw_only=True)
class CellConfig:
    """The simulated cell: what lies on the table, and how well it is seen."""

    dlo: DloPreset = field(default_factory=lambda: SOFT_ROPE)
    """What lies on the table."""
    physics: DloPhysics = field(default_factory=ElasticRod)
    """How it behaves: as an elastic rod, or as a chain that takes a set."""
    nodes: int = 41
    """Nodes of the cell's DLO; the system's own model has another number."""
    timestep_s: float = 0.0025
    """Step of the physics [s]; a whole number of them makes one tick of 10 ms."""
    table: Table = field(default_factory=Table)
    """The table as it is; the system's own belief is `table`."""
    table_friction: float = 0.5
    """Friction of the table; with the DLO's, the larger counts."""
    table_regions: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Factors on the friction in each quarter of the table: near right, near left, far right, far left of the robot.
    An elastic rod feels the mean of where its nodes lie."""
    table_tilt_deg: tuple[float, float] = (0.0, 0.0)
    """Tilt of the table about x and y [°]; nobody tells the system."""
    light: float = 1.0
    """Factor on all light."""
    randomisation: Randomisation = field(default_factory=Randomisation)
    """What is drawn anew for each seed; nothing, unless asked for."""
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
        if not all(math.isfinite(factor) and factor >= 0.0 for factor in self.table_regions):
            raise ConfigError(f"cell.table_regions are {self.table_regions}; each must be 0 or more.")
        if not all(abs(angle) <= 5.0 for angle in self.table_tilt_deg):
            raise ConfigError(f"cell.table_tilt_deg is {self.table_tilt_deg}; up to 5 degrees about each axis.")
        for name in ("light", "settle_s", "image_noise_sigma", "camera_error_m", "camera_error_deg", "table_friction"):
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
