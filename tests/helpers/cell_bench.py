"""A cell on a bus in memory, for drivers and robot components that move its arms, on the clock of the loop."""

from collections.abc import Mapping
from pathlib import Path

from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.urgency import Urgency, never_urgent
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.component import CellComponent
from dlokit.functional.cell.config import CellConfig
from dlokit.types.arrays import Float64Array

STRAIGHT = builtin_shape("I", 0.5, 100)
UNSETTLED = CellConfig(settle_s=0.0)
"""The DLO moves from the beginning, so that no test waits for it."""


class CellBench:
    """The cell and its host, to which components can be added; it runs while `host` is entered."""

    def __init__(
        self,
        start: Float64Array = STRAIGHT,
        config: CellConfig = UNSETTLED,
        *,
        bus: MemoryTransport | None = None,
        seed: int = 0,
        arms: tuple[ArmMount, ...] = FIRST_ALONE,
        instances: Mapping[str, tuple[str, ...]] | None = None,
        truth_folder: Path | None = None,
        urgency: Urgency = never_urgent,
    ) -> None:
        self.bus = MemoryTransport() if bus is None else bus
        self.clock = LoopClock()
        self.host = Container(self.bus, self.clock, instances=instances)
        self.cell = CellComponent(config, start, seed=seed, arms=arms, truth_folder=truth_folder, urgency=urgency)
        self.host.add(self.cell)

    def port(self, owner: str) -> Port:
        """A port of somebody who calls the cell or its arms."""
        return Port(self.bus, self.clock, InlineCompute(), owner=owner, publishes=())
