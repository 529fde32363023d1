"""Settings of the viewer."""

import math
from dataclasses import dataclass
from typing import Annotated

import tyro

from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ViewerConfig:
    """The browser viewer."""

    host: str = "127.0.0.1"
    """Address that the page is served on; with 0.0.0.0, whoever has the page's key can open it from other machines, and
    command the robot."""
    port: Annotated[int, tyro.conf.arg(aliases=("--port",))] = 8080
    """TCP port of the viewer's page; 0 takes any free one."""
    draw_rate_hz: float = 15.0
    """How often the scene is brought up to date, at most [Hz]; nothing is drawn while no browser looks."""
    picture_width_px: int = 320
    """Width of the camera picture that is sent to the browser [px]."""
    goal_x_m: tuple[float, float] = TABLE_X_M
    """Where the goal's frames may be dragged, along x of the world [m]."""
    goal_y_m: tuple[float, float] = TABLE_Y_M
    """Where the goal's frames may be dragged, along y of the world [m]."""

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"--port is {self.port}; it must be 0 (any free port) to 65535.")
        if not (math.isfinite(self.draw_rate_hz) and self.draw_rate_hz > 0.0):
            raise ConfigError(f"viewer.draw-rate-hz is {self.draw_rate_hz}; it must be positive.")
        if self.picture_width_px < 1:
            raise ConfigError(f"viewer.picture-width-px is {self.picture_width_px}; it must be at least 1.")
        for name, (low, high) in (("goal-x-m", self.goal_x_m), ("goal-y-m", self.goal_y_m)):
            if not low < high:
                raise ConfigError(f"viewer.{name} is ({low}, {high}); the first number must be the smaller one.")
