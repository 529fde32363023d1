"""The action strategies there are: ours, and third parties' through the entry points ``dlokit.planners``."""

from importlib.metadata import entry_points

from dlokit.errors import ConfigError
from dlokit.skills.planning.base import StrategyConfig
from dlokit.skills.planning.farthest import FarthestConfig

ENTRY_POINTS = "dlokit.planners"
"""Group of the entry points; each names a configuration class that follows `StrategyConfig`."""

OURS: tuple[type[StrategyConfig], ...] = (FarthestConfig,)
"""Strategies that ship with dlokit, the paper's first."""


def strategies() -> dict[str, type[StrategyConfig]]:
    """Every installed strategy's configuration class by its name, ours first.

    Raises `ConfigError` when two bear the same name.
    """
    found: dict[str, type[StrategyConfig]] = {}
    theirs: list[type[StrategyConfig]] = [entry.load() for entry in entry_points(group=ENTRY_POINTS)]
    for config in (*OURS, *theirs):
        if config.name in found:
            raise ConfigError(
                f"two action strategies are called {config.name!r}: {found[config.name]} and {config}; "
                f"names must differ: rename or uninstall one of them"
            )
        found[config.name] = config
    return found
