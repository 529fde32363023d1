"""The bus of a multi-machine run: each host has one router, and its processes connect through it.

Only the router of the main host listens to the network. The processes of a host reach their router over the socket in a
folder of its user, and open no port.

A pulled cable does not close a connection. The operating system would retransmit for a quarter of an hour, and a router
with a full buffer could not close the link; so each connection gets a limit (``TCP_USER_TIMEOUT``), which
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
from dlokit.communication.zenoh.access import HostRights
from dlokit.communication.zenoh.session import LINK_LEASE_MS, Login, ZenohConfig
from dlokit.extras.hosts.certificates import host_files
from dlokit.extras.hosts.config import HostsConfig, kind_of, lab_password
from dlokit.extras.hosts.placement import Placement, rights_at_main
from dlokit.system.processes.sockets import LocalBus

LOOK_EVERY_S = 1.0
"""Period of the search for new links; until then a new link has the system's own limit."""


@asynccontextmanager
async def limited_links(endpoint: str) -> AsyncGenerator[None]:
    """Limit the retransmission time of all links of this process to or from the port of the endpoint."""
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
    """Limit the existing links, where the operating system supports it (Linux)."""
    option = getattr(socket, "TCP_USER_TIMEOUT", None)
    if option is None:
        return
    for connection in psutil.Process().net_connections(kind="tcp"):
        if connection.raddr and port in (connection.laddr.port, connection.raddr.port):
            # The connection may end meanwhile.
            with contextlib.suppress(OSError), socket.socket(fileno=os.dup(connection.fd)) as link:
                link.setsockopt(socket.IPPROTO_TCP, option, limit_ms)


NAMESPACE = "dlokit/hosts"
"""Namespace of all multi-machine runs; an endpoint serves one at a time."""


def main_router_config(hosts: HostsConfig, placement: Placement, local: LocalBus) -> ZenohConfig:
    """The router to which the other hosts' routers connect. Raises `ConfigError` when a certificate is missing."""
    secured = kind_of(hosts.endpoint) == "tls"
    return ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        listen=(local.endpoint, hosts.endpoint),
        accepts=(local.login, host_login(hosts)),
        tls=host_files(hosts.folder, placement.main) if secured else None,
        others=rights_at_main(placement) if secured else None,
    )


def host_router_config(hosts: HostsConfig, name: str, main: str, local: LocalBus) -> ZenohConfig:
    """The router of the host `name`, which connects to the router of the host `main`. Raises `ConfigError`."""
    secured = kind_of(hosts.endpoint) == "tls"
    return ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        listen=(local.endpoint,),
        connect=(hosts.endpoint,),
        login=host_login(hosts),
        accepts=(local.login,),
        tls=host_files(hosts.folder, name) if secured else None,
        # Only the main host connects, and it checks the rest.
        others=(HostRights(host=main, trusted=True),) if secured else None,
    )


OTHER_HOST = "host"
"""User name with which the router of another host logs in to the main host's."""


def host_login(hosts: HostsConfig) -> Login:
    """The login of other hosts' routers. Raises `ConfigError` when the file of the password is missing or unsafe.

    Over TLS the certificate authenticates a host, and access control grants rights by it alone; zenoh asks for a login
    on every link of a session that asks for one on any.
    """
    if kind_of(hosts.endpoint) == "tls":
        return Login(user=OTHER_HOST, password="its certificate")
    return Login(user=OTHER_HOST, password=lab_password(hosts))
