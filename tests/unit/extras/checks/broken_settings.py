"""Settings that violate one requirement each."""

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar


@dataclass
class Thawed:
    """Not frozen."""

    name: ClassVar[str] = "thawed"


@dataclass(frozen=True)
class NameIsASetting:
    """A name for each instance."""

    name: str = "many"
    """The name."""


@dataclass(frozen=True)
class Spaced:
    """A name of two words."""

    name: ClassVar[str] = "two words"


@dataclass(frozen=True)
class Taken:
    """A name that dlokit uses."""

    name: ClassVar[str] = "cpd"


@dataclass(frozen=True)
class Demanding:
    """A setting without a default."""

    name: ClassVar[str] = "demanding"
    radius_m: float
    """A radius [m]."""


@dataclass(frozen=True)
class Silent:
    """A setting without a docstring."""

    name: ClassVar[str] = "silent"
    radius_m: float = 0.1


@dataclass(frozen=True)
class Bare:
    name: ClassVar[str] = "bare"


@dataclass(frozen=True)
class Stuck:
    """A setting that cannot be sent."""

    name: ClassVar[str] = "stuck"
    thing: Any = dataclasses.field(default_factory=object)
    """Anything."""


@dataclass(frozen=True)
class Kinded:
    """A setting whose name a configuration file uses itself."""

    name: ClassVar[str] = "kinded"
    kind: str = "a"
    """A kind."""


@dataclass(frozen=True)
class Empty:
    """Builds nothing."""

    name: ClassVar[str] = "empty"

    def build(self, dlo: object) -> object:
        return object()
