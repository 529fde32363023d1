"""Planners and observers of the calling program, which the processes of a live system do not have."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from dlokit.skills.observer.strategies import OBSERVERS, own_observer
from dlokit.skills.planning.own import own_planner
from dlokit.skills.planning.strategies import PLANNERS


@dataclass(frozen=True, kw_only=True)
class OwnStrategies:
    """Objects by the names under which they are known in this process."""

    planners: Mapping[str, object] = field(default_factory=dict[str, object])
    observers: Mapping[str, object] = field(default_factory=dict[str, object])

    @contextmanager
    def known(self) -> Generator[None]:
        """Meanwhile this process knows them like installed ones. Raises `ConfigError` for what is not usable."""
        planners = [own_planner(name, planner) for name, planner in self.planners.items()]
        observers = [own_observer(name, observer) for name, observer in self.observers.items()]
        with PLANNERS.given(planners), OBSERVERS.given(observers):
            yield


NOTHING_OWN = OwnStrategies()
