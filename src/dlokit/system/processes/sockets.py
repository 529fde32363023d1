"""The sockets of the systems on this machine, in a folder that only this user may enter, and the key of each system.

The processes of a run meet over Unix sockets in a folder of their own: no port is open, and the operating system keeps
other users out. Each process gets the run's key through a pipe when it starts; zenoh refuses every peer without it, so
that another program of the same user does not join a run by mistake.
"""

import secrets
import shutil
import socket
import struct
import tempfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from dlokit.communication.zenoh.access import OWN_USER
from dlokit.communication.zenoh.session import Login, ZenohConfig
from dlokit.system.processes.runtime_folder import user_folder

_PROTOCOL = "unixsock-stream/"
FIRST = "bus"
"""Name of the socket at which the processes of a system find each other."""
_CREDENTIALS = struct.Struct("3i")  # process, user, group


@dataclass(frozen=True, kw_only=True)
class LocalBus:
    """How the processes of one system on this machine meet."""

    namespace: str
    folder: Path
    """Folder of the sockets."""
    key: str = field(default_factory=lambda: secrets.token_hex(16), repr=False)
    """The key of the run."""

    @property
    def endpoint(self) -> str:
        """Endpoint of the first process, through which all find each other."""
        return _endpoint_of(self.folder / FIRST)

    @property
    def login(self) -> Login:
        """Admits a process to the bus of this system."""
        return Login(user=OWN_USER, password=self.key)

    @property
    def guest(self) -> ZenohConfig:
        """The bus configuration for a process outside the system, such as a command of the same user."""
        return ZenohConfig(namespace=self.namespace, connect=endpoints_of_system(self.endpoint), login=self.login)

    def first(self) -> ZenohConfig:
        """The bus configuration for the first process."""
        return ZenohConfig(
            namespace=self.namespace,
            listen=(self.endpoint,),
            login=self.login,
            accepts=(self.login,),
            discovers_peers=False,
        )

    def process(self, name: str, names: Sequence[str]) -> ZenohConfig:
        """The bus configuration for process `name`: it connects to the first process and to those before it in `names`.

        `names` are all processes but the first, in an order that is the same for all. The later process of each pair
        opens the link, and reopens it after it was closed; if both did, each would close the other's link.
        """
        before = names[: names.index(name)]
        return ZenohConfig(
            namespace=self.namespace,
            listen=(_endpoint_of(self.folder / name),),
            connect=(self.endpoint, *(_endpoint_of(self.folder / other) for other in before)),
            login=self.login,
            accepts=(self.login,),
            discovers_peers=False,
        )

    def client(self) -> ZenohConfig:
        """The bus configuration for a process that connects only to the first process, the router of this host."""
        return ZenohConfig(namespace=self.namespace, role="client", connect=(self.endpoint,), login=self.login)


def endpoints_of_system(first: str) -> tuple[str, ...]:
    """The endpoint of a system's first process, then the endpoints of its other processes that listen now.

    zenoh discovers processes that start later, but does not reopen a link to them after it was closed.
    """
    socket = _socket_of(first)
    others = sorted(path for path in socket.parent.glob("*") if path != socket and path.is_socket())
    return (first, *map(_endpoint_of, others))


def _endpoint_of(socket: Path) -> str:
    return f"{_PROTOCOL}{socket}"


def _socket_of(endpoint: str) -> Path:
    return Path(endpoint.removeprefix(_PROTOCOL))


@contextmanager
def local_bus(namespace: str) -> Generator[LocalBus]:
    """A new folder of sockets and a new key for one system. Raises `MachineError` when there can be no such folder."""
    folder = Path(tempfile.mkdtemp(prefix="", dir=user_folder()))  # mode 0700
    try:
        yield LocalBus(namespace=namespace, folder=folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_sockets(endpoint: str) -> None:
    """Remove the folder of sockets that a killed system has left."""
    folder = _socket_of(endpoint).parent
    if folder.parent == user_folder():
        shutil.rmtree(folder, ignore_errors=True)


class PeerCredentials(NamedTuple):
    """The process at the other end of a Unix socket, when it connected."""

    pid: int
    """0 for a process of another container."""
    user: int


def peer_of(link: socket.socket) -> PeerCredentials | None:
    """Who is at the other end of a Unix socket; None where the system does not say it, or the peer has gone."""
    if not hasattr(socket, "SO_PEERCRED"):  # not on Linux
        return None
    try:
        credentials = link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    except OSError:
        return None
    pid, user, _ = _CREDENTIALS.unpack(credentials)
    return PeerCredentials(pid, user)
