"""Strategies by name: ours and third parties', and how one travels over the bus (a `StrategySpec`).

A skill has one `StrategyKind` for each of its strategy protocols. Over the bus goes a name with settings as JSON; who
receives it knows the type by the name, so decoding never executes anything.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar, Union, get_type_hints

import msgspec

from dlokit.communication.strategy_packages import from_packages
from dlokit.errors import ConfigError, SkillRejected
from dlokit.types.strategy import StrategySpec


class NamedConfig(Protocol):
    """The settings of a strategy: a frozen dataclass with a name of its own."""

    name: ClassVar[str]


C = TypeVar("C", bound=NamedConfig)


@dataclass(frozen=True)
class StrategyKind(Generic[C]):
    """All strategies for one purpose. A configuration field marks itself with its kind: ``Annotated[…, KIND]``."""

    purpose: str
    """What they are called in messages, e.g. ``"observer"``."""
    entry_points: str
    """Group of the entry points by which other packages add theirs; each names a configuration class."""
    ours: tuple[type[C], ...]
    """Strategies that ship with dlokit, the default first."""

    def installed(self) -> dict[str, type[C]]:
        """Every installed strategy's configuration class by its name, ours first.

        One that cannot be used is left out, with a warning the first time. Raises `ConfigError` when two bear the
        same name.
        """
        found: dict[str, type[C]] = {}
        origin: dict[str, str] = {}
        mine = [(config, f"{config.__module__}:{config.__qualname__} of dlokit") for config in self.ours]
        for config, source in (*mine, *self._theirs):
            if config.name in found:
                raise ConfigError(
                    f"two strategies of kind {self.purpose} are called {config.name!r}: {origin[config.name]}, and "
                    f"{source}; names must differ: rename one, or uninstall its package."
                )
            found[config.name] = config
            origin[config.name] = source
        return found

    @cached_property
    def _theirs(self) -> tuple[tuple[type[C], str], ...]:
        return tuple((found.config, found.source) for found in from_packages(self.entry_points))

    def union(self) -> Any:
        """The union of all installed configuration classes, for the command line."""
        return Union[tuple(self.installed().values())]  # noqa: UP007  # its members are known at run time only

    def names(self) -> Any:
        """The literal type of all installed names, for the command line."""
        return Literal[tuple(self.installed())]

    def named(self, name: str, asked_by: str) -> type[C]:
        """The configuration class of that name. Raises `ConfigError`, which begins with `asked_by`."""
        known = self.installed()
        if name not in known:
            raise ConfigError(f"{asked_by} {name!r} is not known; choose one of {', '.join(known)}.")
        return known[name]

    def to_spec(self, config: C) -> StrategySpec:
        """A strategy's settings, as they travel."""
        return StrategySpec(name=config.name, settings=msgspec.json.encode(config))

    def from_spec(self, spec: StrategySpec) -> C:
        """The settings that a spec carries.

        Raises `SkillRejected` with ``unknown_strategy`` or ``bad_settings``.
        """
        known = self.installed()
        if spec.name not in known:
            raise SkillRejected(
                "unknown_strategy", f"no {self.purpose} is called {spec.name!r}; there are {', '.join(known)}"
            )
        wanted = known[spec.name]
        try:
            unknown = set(msgspec.json.decode(spec.settings, type=dict[str, Any])) - set(settings_of(wanted))
            settings = msgspec.json.decode(spec.settings, type=wanted)
        except (msgspec.MsgspecError, ConfigError) as error:
            raise SkillRejected("bad_settings", f"these are not settings of {spec.name!r}: {error}") from error
        if unknown:
            raise SkillRejected(
                "bad_settings", f"{spec.name!r} has no setting {sorted(unknown)}; it has {list(settings_of(wanted))}"
            )
        return settings


def settings_of(config: type[NamedConfig]) -> tuple[str, ...]:
    """The names of a strategy's settings."""
    return tuple(name for name in get_type_hints(config) if name != "name")
