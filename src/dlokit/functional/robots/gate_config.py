"""Settings of the gate before every arm."""

import math
from dataclasses import dataclass
from typing import Annotated

import tyro

from dlokit.errors import ConfigError

SLOWEST_SCALE = 0.05
"""Smallest `speed_scale`: below it a motion takes longer than a skill waits."""


@dataclass(frozen=True, kw_only=True)
class GateConfig:
    """What every motion must keep before it reaches an arm, whatever skill asks for it."""

    workspace_lower_m: tuple[float, float, float] = (-0.3, -0.9, 0.0)
    """Corner of the box that the tool centre point never leaves, with the smallest x, y and z in the world [m]."""
    workspace_upper_m: tuple[float, float, float] = (1.34, 0.9, 1.2)
    """The opposite corner [m]; by default the box holds what one arm, or two opposite arms, reach in front."""
    largest_tool_speed_m_s: float = 2.5
    """Largest speed of the tool centre point [m/s]; joint motions over the table reach 1.9."""
    speed_scale: Annotated[float, tyro.conf.arg(aliases=("--speed-scale",))] = 1.0
    """Factor on the speed of every motion, 0.05 to 1; accelerations change with its square. 0.1 to try things out."""
    feedback_age_s: float = 0.1
    """Largest age of the arm's feedback [s]: a motion does not begin before newer has come, by the machine's clock, and
    is braked on its way by the arm's own clock, which stands while a simulated cell draws a picture."""

    def __post_init__(self) -> None:
        corners = (*self.workspace_lower_m, *self.workspace_upper_m)
        below = all(a < b for a, b in zip(self.workspace_lower_m, self.workspace_upper_m, strict=True))
        if not (below and all(math.isfinite(value) for value in corners)):
            raise ConfigError(
                f"--gate.workspace-lower-m is {self.workspace_lower_m} and --gate.workspace-upper-m "
                f"{self.workspace_upper_m}; they must be finite, and the first below the second in x, y and z."
            )
        if not SLOWEST_SCALE <= self.speed_scale <= 1.0:
            raise ConfigError(f"--speed-scale is {self.speed_scale}; it must be {SLOWEST_SCALE} to 1.")
        for name, value, unit in (
            ("largest-tool-speed-m-s", self.largest_tool_speed_m_s, "m/s"),
            ("feedback-age-s", self.feedback_age_s, "s"),
        ):
            if not 0.0 < value < math.inf:
                raise ConfigError(f"--gate.{name} is {value}; it must be a finite number above 0 in {unit}.")
