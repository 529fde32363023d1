"""Strategies by name: dlokit's own, other packages' by entry point, and their form on the bus.

A skill has one `StrategyKind` for each of its strategy protocols. The bus carries a name with settings as JSON; the
receiver looks up the type by the name, so decoding never executes code.
"""

import dataclasses
import logging
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar, Union, get_type_hints

import msgspec

from dlokit.errors import ConfigError, SkillRejected, missing_extra
from dlokit.types.system import StrategySpec

log = logging.getLogger(__name__)

T = TypeVar("T")

ANNEXES = "dlokit.extras"
"""The package of the annexes; its absence is not an error."""


@dataclass(frozen=True, kw_only=True)
class FoundEntry:
    """The object that one entry point of another package names."""

    value: Any
    source: str
    """The entry point and its package, for error messages."""


def from_packages(group: str, flaw: Callable[[Any], str | None], wanted: str) -> Iterator[FoundEntry]:
    """The objects that a group of entry points names, sorted by name.

    An entry that cannot be imported, or has a `flaw`, is skipped with a warning that names the `wanted` kind of object:
    an error in another package must not disable the rest.
    """
    for entry in sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value)):
        source = _source(entry)
        try:
            value = entry.load()
        except Exception as error:  # the import of another package may raise anything
            if isinstance(error, ModuleNotFoundError) and (lacking := missing_extra(error, source)) is not None:
                log.warning("skipped: %s", lacking)
                continue
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            left_out = isinstance(error, ModuleNotFoundError) and error.name == ANNEXES
            log.log(logging.INFO if left_out else logging.WARNING, "skipped: %s cannot be imported: %s", source, reason)
            continue
        wrong = flaw(value)
        if wrong is None:
            yield FoundEntry(value=value, source=source)
        else:
            log.warning("skipped: %s %s; it must be %s", source, wrong, wanted)


def rows_from_packages(group: str, row: type[T], taken: Iterable[str]) -> tuple[T, ...]:
    """The rows that other packages add to a table, each with a `name`; one whose name is taken is skipped as well."""
    names = set(taken)

    def flaw(value: Any) -> str | None:
        if not isinstance(value, row):
            return f"is a {type(value).__name__}"
        name = getattr(value, "name", "")
        if name in names:
            return f"is called {name!r}, as another"
        names.add(name)
        return None

    return tuple(found.value for found in from_packages(group, flaw, f"a {row.__name__} with a name of its own"))


def _source(entry: EntryPoint) -> str:
    package = "an unknown package" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    return f"{entry.value} of {package} (entry point {entry.group})"


def _flaw(config: Any) -> str | None:
    if not isinstance(config, type) or not dataclasses.is_dataclass(config):
        return "is not a dataclass"
    name = getattr(config, "name", None)
    return None if isinstance(name, str) and name else "has no name"


class NamedConfig(Protocol):
    """The settings of a strategy: a frozen dataclass with a unique name."""

    name: ClassVar[str]


C = TypeVar("C", bound=NamedConfig)


@dataclass(frozen=True)
class StrategyKind(Generic[C]):
    """All strategies for one purpose. A configuration field names its kind in its type: ``Annotated[…, KIND]``."""

    purpose: str
    """Name of the kind in error messages, e.g. ``"observer"``."""
    entry_points: str
    """Group of entry points through which other packages add strategies; each names a configuration class."""
    builtin: tuple[type[C], ...]
    """Strategies that ship with dlokit, the default first."""
    _given: dict[str, type[C]] = field(default_factory=dict[str, type[C]], init=False, compare=False, repr=False)

    @contextmanager
    def given(self, configs: Iterable[type[C]]) -> Generator[None]:
        """Add strategies that no package installs to this process while the context is open.

        Raises `ConfigError` when one has the name of an installed strategy.
        """
        before = dict(self._given)
        self._given.clear()
        installed = self.installed()
        for config in configs:
            if config.name in installed:
                self._given.update(before)
                raise ConfigError(
                    f"{self.purpose} {config.name!r} is the name of a strategy that is installed; choose another name."
                )
            self._given[config.name] = config
        try:
            yield
        finally:
            self._given.clear()
            self._given.update(before)

    def installed(self) -> dict[str, type[C]]:
        """Configuration classes of all installed strategies by name: dlokit's own are first, those in `given` last.

        An unusable one is skipped, with a warning the first time. Raises `ConfigError` when two have the same name.
        """
        found: dict[str, type[C]] = {}
        origin: dict[str, str] = {}
        builtin = [(config, f"{config.__module__}:{config.__qualname__} of dlokit") for config in self.builtin]
        for config, source in (*builtin, *self._external):
            if config.name in found:
                raise ConfigError(
                    f"two strategies of kind {self.purpose} are called {config.name!r}: {origin[config.name]}, and "
                    f"{source}; names must differ: rename one, or uninstall its package."
                )
            found[config.name] = config
            origin[config.name] = source
        return found | self._given

    @cached_property
    def _external(self) -> tuple[tuple[type[C], str], ...]:
        found = from_packages(self.entry_points, _flaw, "a frozen dataclass of settings with a `name`")
        return tuple((entry.value, entry.source) for entry in found)

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
        """A strategy's name and encoded settings, as the bus carries them."""
        return StrategySpec(name=config.name, settings=msgspec.json.encode(config))

    def from_spec(self, spec: StrategySpec) -> C:
        """Decode the settings in a spec.

        Raises `SkillRejected` with ``unknown_strategy`` or ``bad_settings``.
        """
        known = self.installed()
        if spec.name not in known:
            raise SkillRejected(
                "unknown_strategy", f"{self.purpose} {spec.name!r} is not known; choose one of {', '.join(known)}"
            )
        wanted = known[spec.name]
        try:
            unknown = set(msgspec.json.decode(spec.settings, type=dict[str, Any])) - set(settings_of(wanted))
            settings = msgspec.json.decode(spec.settings, type=wanted)
        except (msgspec.MsgspecError, ConfigError) as error:
            raise SkillRejected("bad_settings", f"the settings of {spec.name!r} are not valid: {error}") from error
        if unknown:
            raise SkillRejected(
                "bad_settings", f"{spec.name!r} has no setting {sorted(unknown)}; it has {list(settings_of(wanted))}"
            )
        return settings


def settings_of(config: type[NamedConfig]) -> tuple[str, ...]:
    """The names of a strategy's settings."""
    return tuple(name for name in get_type_hints(config) if name != "name")
