"""What makes the clouds of a case hard."""

from dataclasses import dataclass
from typing import Literal

Place = Literal["middle", "tip", "moving"]

RECOVERED_WITHIN = 10
"""Frames that a track may take to recover after the dark."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What makes a cloud hard; the default is the base case."""

    hidden: float = 0.3
    """Share of the DLO's length that a ball hides."""
    place: Place = "middle"
    """Where the ball stands: in front of the middle, of node 0, or going to and fro."""
    noise_m: float = 0.002
    """Standard deviation of the depth at `stereo.NOISE_DEPTH_M` [m]."""
    outliers: float = 0.05
    """Share of the cloud's points that belong to nothing."""
    points: int = 1000
    """Points of a cloud that shows all of the DLO; one that shows half has half."""
    dark_s: float = 0.0
    """For how long nothing at all is seen [s]; `dark_frames` says when."""
    camera_error_m: float = 0.0
    """How far the camera is from where it is believed to be [m]."""
    camera_error_rad: float = 0.0
    """How far it is turned from how it is believed to be [rad]."""


def dark_frames(conditions: Conditions, frames: int, rate_hz: float) -> range:
    """The frames of a sequence in which nothing is seen: a third of the others comes before, two thirds after."""
    dark = round(conditions.dark_s * rate_hz)
    first = max(1, (frames - dark) // 3)
    return range(first, first + dark)


def long_enough(conditions: Conditions, frames: int, rate_hz: float) -> bool:
    """Whether the light is on before the dark, and after it for as many frames as a track may take to recover."""
    dark = dark_frames(conditions, frames, rate_hz)
    return len(dark) == 0 or (dark.start >= 3 and frames - dark.stop > RECOVERED_WITHIN)
