"""The bus of a run on several hosts: each host has one door, and its processes go through it.

The main host's door is the only one that listens to the network. Processes of a host reach their door over the loopback
interface, and open no port.

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

from dlokit.communication.container import end_tasks
from dlokit.communication.zenoh.session import LINK_LEASE_MS, ZenohConfig
from dlokit.system.hosts.certificates import host_files
from dlokit.system.hosts.config import HostsConfig, kind_of
from dlokit.system.hosts.placement import Placement, placed, rights_at_main, rights_elsewhere
from dlokit.system.table import ProcessRow

LOOK_EVERY_S = 1.0
"""A link that is new since then has the system's own patience until the next look."""


@asynccontextmanager
async def limited_links(endpoint: str) -> AsyncGenerator[None]:
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


NAMESPACE = "dlokit/hosts"
"""Of all runs on several hosts: at one endpoint there is one at a time."""


def check_hosts(hosts: HostsConfig, rows: tuple[ProcessRow, ...]) -> None:
    """Raise `ConfigError` for what is placed wrongly, or for a certificate of the main host that is missing."""
    placement = placed(hosts, rows)
    if kind_of(hosts.endpoint) == "tls":
        host_files(hosts.folder, placement.main)


def main_door(hosts: HostsConfig, placement: Placement, local_endpoint: str) -> ZenohConfig:
    """The door at which the other hosts' doors connect. Raises `ConfigError` when a certificate is missing."""
    secured = kind_of(hosts.endpoint) == "tls"
    return ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        listen=(local_endpoint, hosts.endpoint),
        tls=host_files(hosts.folder, placement.main) if secured else None,
        others=rights_at_main(placement) if secured else None,
    )


def other_door(hosts: HostsConfig, name: str, main: str, local_endpoint: str) -> ZenohConfig:
    """The door of the host `name`, which connects to the one of the host `main`. Raises `ConfigError`."""
    secured = kind_of(hosts.endpoint) == "tls"
    return ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        listen=(local_endpoint,),
        connect=(hosts.endpoint,),
        tls=host_files(hosts.folder, name) if secured else None,
        others=rights_elsewhere(main) if secured else None,
    )


def local_endpoint_config(local_endpoint: str) -> ZenohConfig:
    """How a process of a host joins the bus."""
    return ZenohConfig(namespace=NAMESPACE, role="client", listen=(), connect=(local_endpoint,))
