"""The sockets of the systems on this machine, in a folder that only this user may enter, and the key of each system.

The processes of a run meet over Unix sockets in a folder of their own: no port is open, and the operating system keeps
other users out. Each process gets the run's key through a pipe when it starts; zenoh refuses every peer without it, so
that another program of the same user does not join a run by mistake.
"""

import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from dlokit.communication.zenoh.access import OWN_USER
from dlokit.communication.zenoh.session import Login, ZenohConfig
from dlokit.errors import MachineError

LONGEST_SOCKET = 107
"""Maximum length of the path of a Unix socket on Linux [bytes]; other systems allow 103."""
ROOM = 60
"""Bytes of the path that are reserved for names inside the user's folder."""
_PROTOCOL = "unixsock-stream/"
RUNTIME_DIR = "DLOKIT_RUNTIME_DIR"
"""Environment variable that names the folder in which the systems of a user announce themselves."""
_CHOOSE = f"set {RUNTIME_DIR} to another folder"
FIRST = "bus"
"""Name of the socket at which the processes of a system find each other."""


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


def user_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """The folder of this user's sockets and notes of running systems, of mode 0700.

    `DLOKIT_RUNTIME_DIR` names it. Systems of different folders do not find one another: `dlokit stop` reaches only the
    systems of its folder. Without the variable, it is in the user's runtime directory if it exists, else in the
    directory for temporary files. Raises `MachineError` when another user created it first, or may enter it.
    """
    if chosen := environment.get(RUNTIME_DIR):
        path = Path(chosen).absolute()
        if _fits(path):
            return private_folder(path)
        raise MachineError(f"{RUNTIME_DIR} is {path}, which is too long for the path of a socket: name a shorter one.")
    for parent, name in _places(environment):
        path = parent / name
        if _fits(path):
            return private_folder(path)
    raise MachineError(f"{tempfile.gettempdir()} is too long for a socket: set {RUNTIME_DIR} to a shorter folder.")


def _fits(folder: Path) -> bool:
    return len(os.fsencode(folder)) + ROOM <= LONGEST_SOCKET


def _places(environment: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    user = os.getuid()
    # A shell without XDG_RUNTIME_DIR, such as a cron job's, must find the same systems.
    for runtime in (environment.get("XDG_RUNTIME_DIR", ""), f"/run/user/{user}"):
        # After `su` the variable may name the folder of the user before.
        if os.path.isabs(runtime) and _owner(Path(runtime)) == user:
            yield Path(runtime), "dlokit"
    for temporary in dict.fromkeys((tempfile.gettempdir(), "/tmp")):
        yield Path(temporary), f"dlokit-{user}"


def _owner(path: Path) -> int | None:
    try:
        return path.stat().st_uid
    except OSError:
        return None


def private_folder(path: Path) -> Path:
    """Make a folder for this user only, or check that it is one. Raises `MachineError`."""
    try:
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
        facts = path.lstat()
    except OSError as error:
        raise MachineError(f"{path} cannot be made: {error}; {_CHOOSE} that you may write to.") from error
    why = ""
    if not stat.S_ISDIR(facts.st_mode):
        why = "is not a folder"
    elif facts.st_uid != os.getuid():
        why = "belongs to another user"
    elif stat.S_IMODE(facts.st_mode) & 0o077:
        why = f"has mode {stat.S_IMODE(facts.st_mode):o}, so that other users may enter it; it must be 700"
    if why:
        raise MachineError(f"{path} {why}: remove it, or {_CHOOSE}.")
    return path
