"""Buses for the tests: over sockets and with a key, as the processes of a system have them, or in memory."""

import itertools
import tempfile
from collections import defaultdict
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.processes.bus import JoinedBus, clock_of, ticking
from dlokit.system.processes.running import RunningSystem
from dlokit.system.processes.sockets import LocalBus
from dlokit.system.table import TimeBase

# Not in `tmp_path`, whose name is too long for a socket.
_FOLDER = tempfile.TemporaryDirectory(prefix="dlk")
_numbers = itertools.count()


def new_bus() -> LocalBus:
    folder = Path(_FOLDER.name) / str(next(_numbers))
    folder.mkdir()
    return LocalBus(namespace=f"dlokit_test/{folder.name}", folder=folder)


def bus_of(system: RunningSystem) -> LocalBus:
    """The bus of a noted system, for the test that plays its first process."""
    folder = Path(system.endpoint.removeprefix("unixsock-stream/")).parent
    return LocalBus(namespace=system.namespace, folder=folder, key=system.key)


class MemoryBuses:
    """Buses in memory, by namespace. Whoever joins one is on it with all others, and leaves it as it is."""

    def __init__(self) -> None:
        self._transports: defaultdict[str, MemoryTransport] = defaultdict(MemoryTransport)

    def of(self, system: RunningSystem) -> MemoryTransport:
        """The transport of a noted system."""
        return self._transports[system.namespace]

    @asynccontextmanager
    async def join(self, config: ZenohConfig, time_base: TimeBase, /) -> AsyncGenerator[JoinedBus]:
        """As `join_bus`."""
        transport, clock = self._transports[config.namespace], clock_of(time_base)
        async with ticking(transport, clock, time_base):
            yield JoinedBus(transport, clock)
