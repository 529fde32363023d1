"""Settings of the self-organising map."""

from dataclasses import dataclass, field
from typing import ClassVar

from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.visibility_config import VisibilityConfig


@dataclass(frozen=True, kw_only=True)
class SomConfig:
    """Self-organising map: no assumption on the motion; nodes spread as evenly as the points do."""

    name: ClassVar[str] = "som"

    initial_radius: float = 4.6
    """r at the first iteration, in mean edges of the DLO: about how many neighbours a point draws along."""
    final_radius: float = 1.1
    """r at the last iteration, in mean edges; below 0.3 neighbours hardly count."""
    iterations: int = 40
    """How often the neurons are updated while r shrinks by a constant factor."""
    misfit_share: float = 0.95
    """r is at most the distance that this share of the points is nearer to their neuron than, in mean edges."""
    gate_m: float = 0.021
    """Points farther from all neurons than this and r edges draw none [m]; several times the noise. The edges,
    at their mean length at rest, are by how much a neighbourhood pulls in the tips, and the motion at first."""
    shrunk: float = 0.74
    """Nodes may be hidden where the map's edges are in all shorter than this share of their length at rest."""
    torn: float = 2.8
    """Nodes may be hidden where an edge of the map is longer than so many times its length at rest,
    or, if that is more, the mean length of all edges."""
    empty: float = 0.32
    """Where nodes may be hidden, those are that at the prior win fewer points than this share of the median."""
    max_points: int = 700
    """Larger clouds are thinned, evenly over their index, to so many points."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """When a node counts as seen."""

    def build(self) -> ObserverStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.observer.som import Som

        return Som(self)
