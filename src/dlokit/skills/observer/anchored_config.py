"""Settings of the observer `anchored`."""

from dataclasses import dataclass, field
from typing import ClassVar

from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.cpd_config import CpdConfig, pliable
from dlokit.skills.observer.curve_config import CurveConfig
from dlokit.skills.observer.visibility_config import VisibilityConfig


@dataclass(frozen=True, kw_only=True)
class AnchoredConfig:
    """Coherent point drift, with nodes held at their arc length from the tips and pins that are seen."""

    name: ClassVar[str] = "anchored"

    cpd: CpdConfig = field(default_factory=pliable)
    """The registration that finds the curve and which way round the rod lies."""
    curve: CurveConfig = field(default_factory=CurveConfig)
    """The fit of the centre line."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """When a node counts as seen."""
    length_tolerance: float = 0.06
    """Both tips count as seen when the seen curve is shorter or longer than the rod by at most this share."""
    tip_snap_m: float = 0.03
    """An end of a curve that is too short counts as a tip when registration puts it so near to one [m]."""

    def build(self) -> ObserverStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.observer.anchored import Anchored

        return Anchored(self)
