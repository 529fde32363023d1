"""Settings of the MAP observer."""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.map.settings import MapSettings


@dataclass(frozen=True, kw_only=True)
class MapConfig(MapSettings):
    """The most probable rod: stiff lengths, coherent motion, seen tips; says how sure it is of each node."""

    name: ClassVar[str] = "map"

    def build(self) -> ObserverStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.observer.map.observer import MapObserver

        return MapObserver(self)
