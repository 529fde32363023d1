"""A lab as a third party has it: an arm and a camera whose drivers come with a package of its own.

Behind them is a simulated cell, in the process of the arm's driver. The system does not know it: it has no component
`cell`, and the cell's truth stays in the driver. The rope stays on the table between runs, in the file of
`OWN_LAB_TABLE`, as a real one does.
"""

import os
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

import msgspec
import numpy as np
from made_results import PROTECTED

from dlokit.communication.container import Container
from dlokit.communication.port import Port
from dlokit.communication.timing.pulse import Pulse
from dlokit.description.arm.mounts import ArmMount
from dlokit.functional.cameras.base import Caller, Camera
from dlokit.functional.cameras.simulated import SimulatedCamera
from dlokit.functional.cell.component import CellComponent
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.simulated import SimulatedRobot
from dlokit.types.image import CameraPictures
from dlokit.types.robot import ArmProtection

TABLE = "OWN_LAB_TABLE"
"""Environment variable: the .npy file that keeps where the rope lies, (K, 3) [m]."""
# Small pictures, so that the cell keeps real time on a busy machine.
CELL = replace(CellConfig(), width_px=480, height_px=420)


class OwnArm(SimulatedRobot):
    """Drives an arm over the network of its own controller, which is the cell."""

    def __init__(self, port: Port, mount: ArmMount, pulse: Pulse) -> None:
        super().__init__(port, mount, pulse)
        transport: Any = vars(port)["_transport"]
        self._table = Path(os.environ[TABLE])
        self._cell = CellComponent(CELL, np.load(self._table), seed=0, arms=(mount,))
        self._lab = Container(transport, port.clock)
        self._lab.add(self._cell)
        self._open = AsyncExitStack()

    async def __aenter__(self) -> Self:
        await self._open.enter_async_context(self._lab)
        return await super().__aenter__()

    async def _read_states(self) -> None:
        """As a driver of hardware: the cell's own clock is late on a busy machine, so the host's stamps."""
        async for state in self._port.stream(self._states):
            self._state = msgspec.structs.replace(state, stamp_ns=time.monotonic_ns())
            self._heard.set()

    def now_ns(self) -> int:
        return self.newest_ns()

    def newest_ns(self) -> int:
        return self.state().stamp_ns

    def protection(self) -> ArmProtection:
        return PROTECTED

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await super().__aexit__(kind, error, trace)
        np.save(self._table, self._cell.true_nodes_world())
        await self._open.aclose()


@dataclass(frozen=True, kw_only=True)
class OwnArmConfig:
    """The arm of the lab."""

    name: ClassVar[str] = "own-arm"
    in_cell: ClassVar[bool] = False
    is_real: ClassVar[bool] = True

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        return OwnArm(port, mount, pulse)


class OwnCamera(SimulatedCamera):
    """Asks the cell for pictures, and stamps them by the clock of the host."""

    async def capture(self, timeout_s: float) -> CameraPictures:
        asked_ns = time.monotonic_ns()
        return msgspec.structs.replace(await super().capture(timeout_s), stamp_ns=asked_ns)


@dataclass(frozen=True, kw_only=True)
class OwnCameraConfig:
    """The stereo camera of the lab."""

    name: ClassVar[str] = "own-camera"
    sees_cell: ClassVar[bool] = False

    def build(self, caller: Caller) -> Camera:
        return OwnCamera(caller)
