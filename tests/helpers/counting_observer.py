"""An observer with a memory: it counts the clouds that it was given."""

from dataclasses import dataclass, field
from typing import ClassVar

import msgspec
import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import Anchored
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation


@dataclass(frozen=True)
class CountingConfig:
    """Settings of the observer that counts."""

    name: ClassVar[str] = "counting"

    fails_at: int = 0
    """Count at which it raises an error; 0: never."""
    numbers: int = 1
    """Numbers in its memory."""
    health: float = 1.0
    """Health of its targets."""
    given: list[int] = field(default_factory=list[int])
    """Each call adds the number of clouds in the memory that it was given."""

    def build(self, dlo: BelievedDlo) -> "Counting":
        return Counting(self)


class Counting:
    def __init__(self, config: CountingConfig) -> None:
        self._config = config

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        self._config.given.append(counted(prior.memory))
        count = self._config.given[-1] + 1
        if count == self._config.fails_at:
            raise ValueError("a memory that it cannot use")
        memory = {"clouds": np.full(self._config.numbers, float(count))}
        found = Anchored().estimate(seen, prior)
        return msgspec.structs.replace(found, memory=memory, health=self._config.health)


def counted(memory: dict[str, Float64Array]) -> int:
    """The number of clouds in a memory; 0 where it is empty."""
    return int(memory["clouds"][0]) if memory else 0
