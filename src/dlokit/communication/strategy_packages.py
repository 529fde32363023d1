"""Strategies of other packages, found by their entry points."""

import dataclasses
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

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
