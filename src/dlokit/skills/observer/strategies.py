"""The observers there are: ours, and third parties' through the entry points ``dlokit.observers``."""

from typing import Annotated, get_args

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.skills.observer.anchored import AnchoredConfig
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.map.observer import MapConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig

OurObserver = MapConfig | AnchoredConfig | CpdConfig | SprConfig | SomConfig
"""Strategies that ship with dlokit, the default first; the one place where they are named."""

OURS: tuple[type[OurObserver], ...] = get_args(OurObserver)

OBSERVERS: StrategyKind[ObserverStrategyConfig] = StrategyKind("observer", "dlokit.observers", OURS)

Observer = Annotated[ObserverStrategyConfig, OBSERVERS, tyro.conf.arg(constructor_factory=OBSERVERS.union)]
"""The settings of any installed observer: a choice on the command line and in configuration files."""

strategies = OBSERVERS.installed
to_spec = OBSERVERS.to_spec
from_spec = OBSERVERS.from_spec
