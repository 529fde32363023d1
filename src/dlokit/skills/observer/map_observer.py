"""The most probable nodes given the cloud and what a rod is: an iterated Gauss-Newton MAP with a banded solve.

Two stages a cloud, each with x from H x = b of `map_terms` at every step. Coarse (`map_coarse`): points belong to
nodes softly, with a Gaussian that narrows. Fine (`map_fine`): nodes take the places along the rod that the
seen tips give them, and points lie on segments, within a window of arc length, outliers weighed down. H also
gives each node's covariance (`map_trust`). docs/explanations/map-observer.md has the whole.
"""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.observer.anchored import is_chain
from dlokit.skills.observer.base import nothing_seen
from dlokit.skills.observer.cpd import register
from dlokit.skills.observer.map_coarse import coarse
from dlokit.skills.observer.map_fine import fine
from dlokit.skills.observer.map_frame import framed
from dlokit.skills.observer.map_settings import MapSettings
from dlokit.skills.observer.map_trust import health, stated_covariance
from dlokit.skills.observer.mixture import thinned
from dlokit.skills.observer.partial import register_visible
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class MapConfig(MapSettings):
    """The most probable rod: stiff lengths, coherent motion, seen tips; says how sure it is of each node."""

    name: ClassVar[str] = "map"

    def build(self) -> "MapObserver":
        """The strategy with these settings."""
        return MapObserver(self)


class MapObserver:
    """Coarse stage, fine stage, covariance and health."""

    def __init__(self, config: MapConfig | None = None) -> None:
        self._config = config or MapConfig()

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The most probable nodes in the order of `prior`, their covariance (M, 3, 3) [m²], and health.

        A DLO that is not one chain of at least 4 nodes is registered by coherent point drift, without covariance.
        """
        config = self._config
        if len(seen.points_world) == 0:
            return nothing_seen(seen, prior)
        if not is_chain(prior.topology) or len(prior.nodes_world) < 4:
            points = seen.points_world.astype("float64")
            first = register(thinned(points, config.cpd.max_points), prior.nodes_world, config.cpd)
            return register_visible(points, first, seen, prior, config.cpd, config.visibility)
        frame = framed(seen, prior, config)
        nodes, before = coarse(frame, config)
        fitted = fine(frame, nodes, before, config)
        covariance = stated_covariance(frame, before, fitted, config)
        return TargetPoints(
            stamp_ns=seen.stamp_ns,
            nodes_world=fitted.nodes + frame.origin,
            visible=fitted.supported & ~fitted.shaded,
            covariance=covariance,
            health=health(frame, fitted, covariance, config),
        )
