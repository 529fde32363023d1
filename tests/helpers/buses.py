"""A bus for the transports of one test, over sockets and with a key, as the processes of a system have it."""

import itertools
import tempfile
from pathlib import Path

from dlokit.system.processes.running import RunningSystem
from dlokit.system.processes.sockets import LocalBus

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
