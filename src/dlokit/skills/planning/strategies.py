"""The action strategies there are: ours, and third parties' through the entry points ``dlokit.planners``."""

from importlib.metadata import entry_points

from dlokit.communication import codec
from dlokit.errors import CommunicationError, ConfigError, SkillRejected
from dlokit.skills.planning.base import StrategyConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.types.strategy import StrategySpec

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


def to_spec(config: StrategyConfig) -> StrategySpec:
    """A strategy's settings, as they travel."""
    return StrategySpec(name=config.name, settings=codec.encode(config))


def from_spec(spec: StrategySpec) -> StrategyConfig:
    """The settings that a spec carries.

    Raises `SkillRejected` with ``unknown_strategy`` or ``bad_settings``.
    """
    known = strategies()
    if spec.name not in known:
        raise SkillRejected(
            "unknown_strategy", f"no action strategy is called {spec.name!r}; there are {sorted(known)}"
        )
    try:
        return codec.decode(spec.settings, known[spec.name])
    except CommunicationError as error:
        raise SkillRejected("bad_settings", f"these are not settings of {spec.name!r}: {error}") from error
