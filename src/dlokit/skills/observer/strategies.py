"""The observers there are: ours, and third parties' through the entry points ``dlokit.observers``."""

from importlib.metadata import entry_points
from typing import Any, get_args, get_type_hints

import msgspec

from dlokit.errors import ConfigError, SkillRejected
from dlokit.skills.observer.anchored import AnchoredConfig
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.map_observer import MapConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig
from dlokit.types.strategy import StrategySpec

ENTRY_POINTS = "dlokit.observers"
"""Group of the entry points; each names a configuration class that follows `ObserverStrategyConfig`."""

OurObserver = AnchoredConfig | CpdConfig | SprConfig | SomConfig | MapConfig
"""Strategies that ship with dlokit, the default first; the one place where they are named."""

OURS: tuple[type[OurObserver], ...] = get_args(OurObserver)


def strategies() -> dict[str, type[ObserverStrategyConfig]]:
    """Every installed observer's configuration class by its name, ours first.

    Raises `ConfigError` when two bear the same name.
    """
    found: dict[str, type[ObserverStrategyConfig]] = {}
    theirs: list[type[ObserverStrategyConfig]] = [entry.load() for entry in entry_points(group=ENTRY_POINTS)]
    for config in (*OURS, *theirs):
        if config.name in found:
            raise ConfigError(
                f"two observers are called {config.name!r}: {found[config.name]} and {config}; "
                f"names must differ: rename or uninstall one of them"
            )
        found[config.name] = config
    return found


def to_spec(config: ObserverStrategyConfig) -> StrategySpec:
    """A strategy's settings, as they travel."""
    return StrategySpec(name=config.name, settings=msgspec.json.encode(config))


def from_spec(spec: StrategySpec) -> ObserverStrategyConfig:
    """The settings that a spec carries.

    Raises `SkillRejected` with ``unknown_strategy`` or ``bad_settings``.
    """
    known = strategies()
    if spec.name not in known:
        raise SkillRejected("unknown_strategy", f"no observer is called {spec.name!r}; there are {sorted(known)}")
    wanted = known[spec.name]
    try:
        unknown = set(msgspec.json.decode(spec.settings, type=dict[str, Any])) - set(fields_of(wanted))
        settings = msgspec.json.decode(spec.settings, type=wanted)
    except msgspec.MsgspecError as error:
        raise SkillRejected("bad_settings", f"these are not settings of {spec.name!r}: {error}") from error
    if unknown:
        raise SkillRejected(
            "bad_settings", f"{spec.name!r} has no setting {sorted(unknown)}; it has {list(fields_of(wanted))}"
        )
    return settings


def fields_of(config: type[ObserverStrategyConfig]) -> tuple[str, ...]:
    """The names of a strategy's settings."""
    return tuple(name for name in get_type_hints(config) if name != "name")
