"""How long a link between hosts may leave what was sent unacknowledged.

A cable that is pulled closes no connection. The system would send again for a quarter of an hour, and a door whose
buffer is full meanwhile could not even close the link; so each connection gets a limit (``TCP_USER_TIMEOUT``), which
zenoh cannot set.
"""

import asyncio
import contextlib
import os
import socket
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import psutil

from dlokit.communication.zenoh.session import LINK_LEASE_MS
from dlokit.system.tasks import end_tasks

LOOK_EVERY_S = 1.0
"""A link that is new since then has the system's own patience until the next look."""


@asynccontextmanager
async def impatient_links(endpoint: str) -> AsyncGenerator[None]:
    """Limit all links of this process to or from a port meanwhile: that of the endpoint where hosts meet."""
    port = int(endpoint.rpartition(":")[2])
    looking = asyncio.create_task(_look(port), name="limit links")
    try:
        yield
    finally:
        await end_tasks(looking)


async def _look(port: int) -> None:
    while True:
        limit_links(port, LINK_LEASE_MS)
        await asyncio.sleep(LOOK_EVERY_S)


def limit_links(port: int, limit_ms: int) -> None:
    """Limit those that there are, where the system knows such a limit (Linux)."""
    option = getattr(socket, "TCP_USER_TIMEOUT", None)
    if option is None:
        return
    for connection in psutil.Process().net_connections(kind="tcp"):
        if connection.raddr and port in (connection.laddr.port, connection.raddr.port):
            with contextlib.suppress(OSError), socket.socket(fileno=os.dup(connection.fd)) as link:  # it may just end
                link.setsockopt(socket.IPPROTO_TCP, option, limit_ms)
