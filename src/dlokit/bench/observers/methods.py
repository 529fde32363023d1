"""The methods of the bench: every installed observer with its default settings, and the peers."""

from dataclasses import dataclass

from dlokit.bench.observers.peers import PEERS, missing
from dlokit.errors import ConfigError, MachineError
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig
from dlokit.skills.observer.strategies import strategies

PINNED = ", pinned"
"""Behind the name of an observer that was told where the grippers hold the DLO."""


PUBLISHED = (*(peer.name for peer in PEERS), CpdConfig.name, SprConfig.name, SomConfig.name)
"""The methods of others: packages, and our own implementations of papers."""


@dataclass(frozen=True, kw_only=True)
class ObserverMethod:
    """One observer, with or without the pins that a robot knows."""

    config: ObserverStrategyConfig
    pinned: bool = False

    @property
    def states_trust(self) -> bool:
        """Whether its health is its own: the packages of others state none, and their adapters make none up."""
        return not isinstance(self.config, PEERS)

    @property
    def name(self) -> str:
        """As tables call it."""
        return f"{self.config.name}{PINNED}" if self.pinned else self.config.name


@dataclass(frozen=True, kw_only=True)
class MethodChoice:
    """What will run, and what was left out and why."""

    methods: tuple[ObserverMethod, ...]
    left_out: tuple[str, ...]


def default_name() -> str:
    """The name of the observer that the system uses by default."""
    return ObserverConfig().strategy.name


def choose(names: tuple[str, ...] = ()) -> MethodChoice:
    """The methods of these names, or all: ours without and with pins, peers without, for they cannot use them.

    A peer that is not installed is left out, unless it was asked for. Raises `ConfigError` for a name that does
    not exist, `MachineError` for a peer that was asked for and is missing.
    """
    ours = strategies()
    peers = {peer.name: peer for peer in PEERS}
    unknown = [name for name in names if name not in ours and name not in peers]
    if unknown:
        raise ConfigError(f"No observer is called {', '.join(unknown)}; there are {', '.join([*ours, *peers])}.")
    methods: list[ObserverMethod] = []
    for name, config in ours.items():
        if not names or name in names:
            methods += [ObserverMethod(config=config()), ObserverMethod(config=config(), pinned=True)]
    left_out: list[str] = []
    for name, config in peers.items():
        if names and name not in names:
            continue
        reason = missing(name)
        if reason is None:
            methods.append(ObserverMethod(config=config()))
        elif names:
            raise MachineError(reason)
        else:
            left_out.append(reason)
    return MethodChoice(methods=tuple(methods), left_out=tuple(left_out))
