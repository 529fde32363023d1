"""Settings of the fit of a centre line."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class CurveConfig:
    """How a centre line is fitted."""

    reach_m: float = 0.02
    """Points farther from the guide than this do not belong to the DLO [m]; also how far ends are searched."""
    spread_m: float = 0.008
    """Points farther from the fitted curve than this are outliers [m]: radius and three times the noise."""
    smoothing_m: float = 0.012
    """Bends shorter than this are taken for noise [m]."""
    bin_m: float = 0.005
    """Length of curve over which points are averaged [m]."""
    gap_m: float = 0.02
    """A stretch without points is a gap when it is longer than this [m]."""
    iterations: int = 3
    """How often the curve becomes the next guide."""
