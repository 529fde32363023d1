"""Strategies by name: ours and third parties' by their entry points, and how one travels over the bus.

A skill has one `StrategyKind` for each of its strategy protocols. Over the bus goes a name with settings as JSON; who
receives it knows the type by the name, so decoding never executes anything.
"""

import dataclasses
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar, Union, get_type_hints

import msgspec

from dlokit.errors import ConfigError, SkillRejected
from dlokit.types.system import StrategySpec

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class FoundStrategy:
    """One configuration class of another package."""

    config: Any
    source: str
    """The class and its package, for messages."""


def from_packages(group: str) -> Iterator[FoundStrategy]:
    """The strategies of a group of entry points, in the order of their names.

    One that cannot be imported, or is no configuration class, is left out with a warning: another package's mistake
    must not stop the rest.
    """
    for entry in sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value)):
        source = _source(entry)
        try:
            config = entry.load()
        except Exception as error:  # whatever a package's import may raise
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            log.warning("left out: %s cannot be imported: %s", source, reason)
            continue
        flaw = _flaw(config)
        if flaw is None:
            yield FoundStrategy(config=config, source=source)
        else:
            log.warning("left out: %s %s; a frozen dataclass of settings with a `name` is wanted", source, flaw)


def _source(entry: EntryPoint) -> str:
    package = "an unknown package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    return f"{entry.value} of {package} (entry point {entry.group})"


def _flaw(config: Any) -> str | None:
    if not isinstance(config, type) or not dataclasses.is_dataclass(config):
        return "is no dataclass"
    name = getattr(config, "name", None)
    return None if isinstance(name, str) and name else "has no name"


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
