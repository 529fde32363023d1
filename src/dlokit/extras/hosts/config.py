"""The section `[hosts]` of a configuration: which host runs which processes, endpoints and certificates."""

import hashlib
import ipaddress
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from dlokit.errors import ConfigError, InputError

AUTHORITY = "ca"
"""File name of the authority without suffix; no host may have this name."""

SHORTEST_PASSWORD = 16
"""Shortest password between hosts without TLS [characters]; an eavesdropper can guess short ones."""

_NAME = re.compile(r"[a-z0-9]([a-z0-9-]{0,30}[a-z0-9])?")
_ADDRESS = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")


@dataclass(frozen=True, kw_only=True)
class LabHost:
    """A host of a lab: its name, and its addresses for other hosts."""

    name: str
    addresses: tuple[str, ...] = ()
    """IP addresses and names at which other hosts connect to it; empty if it accepts no connections."""

    def __post_init__(self) -> None:
        if self.name == AUTHORITY or not _NAME.fullmatch(self.name):
            raise InputError(
                f"{self.name!r} is not a valid host name: allowed are up to 32 small letters, digits and -, "
                f"but not {AUTHORITY!r}."
            )
        for address in self.addresses:
            if not is_ip(address) and not _ADDRESS.fullmatch(address):
                raise InputError(f"{address!r} is neither an IP address nor the name of a machine.")


def is_ip(address: str) -> bool:
    """Whether it is an IP address instead of a name."""
    try:
        ipaddress.ip_address(address)
    except ValueError:
        return False
    return True


Kind = Literal["tls", "tcp"]


@dataclass(frozen=True, kw_only=True)
class HostsConfig:
    """The section `[hosts]` of a configuration: a run on several machines."""

    endpoint: str
    """Endpoint at which the host of the decision process listens for the other hosts: `tls/10.0.0.1:7447`."""
    certificates: str = ""
    """Folder with `ca.pem` and this host's certificate and key, created by `dlokit certs`."""
    runs: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Host → processes, e.g. `decision = ["decision", "simulation", "observer"]`; each process on one host."""
    password_file: str = ""
    """For an endpoint `tcp/…`: a file with the password that all hosts share, readable only by its owner.

    The data are not encrypted: anyone with access to the network between the machines can read and alter them.
    """
    wait_s: float = 60.0
    """Time for which a run waits for its other hosts [s]."""

    def __post_init__(self) -> None:
        if kind_of(self.endpoint) == "tcp" and not self.password_file:
            raise ConfigError(
                f"the hosts' endpoint is {self.endpoint}, which is not encrypted: use tls/… with certificates of "
                "`dlokit certs`; or, on a dedicated cable, write the same long random password into a file of mode 600 "
                "on each host, and name it as password_file in [hosts]."
            )
        if kind_of(self.endpoint) == "tls" and not self.certificates:
            raise ConfigError(
                f"the hosts' endpoint is {self.endpoint}, and [hosts] has no folder `certificates`: create one with "
                "`dlokit certs FOLDER --hosts …`."
            )
        if not 0.0 < self.wait_s < 86_400.0:
            raise ConfigError(f"wait_s in [hosts] is {self.wait_s}; it must be greater than 0 and less than a day.")
        for host in self.runs:
            LabHost(name=host)

    @property
    def folder(self) -> Path:
        """Folder of the certificates."""
        return Path(self.certificates).expanduser()


def lab_password(hosts: HostsConfig) -> str:
    """The password that the hosts of a lab without TLS share, as a digest. Raises `ConfigError`."""
    path = Path(hosts.password_file).expanduser()
    try:
        mode, text = stat.S_IMODE(path.stat().st_mode), path.read_bytes().strip()
    except OSError as error:
        raise ConfigError(f"password_file in [hosts] cannot be read: {error}.") from error
    if mode & 0o077:
        raise ConfigError(f"password_file {path} has mode {mode:o}; others may read it: run chmod 600 {path}.")
    if len(text) < SHORTEST_PASSWORD:
        raise ConfigError(
            f"password_file {path} has {len(text)} characters; it needs at least {SHORTEST_PASSWORD}: "
            f"openssl rand -hex 16 > {path}."
        )
    return hashlib.sha256(text).hexdigest()


def kind_of(endpoint: str) -> Kind:
    """Whether the endpoint uses TLS. Raises `ConfigError` for an invalid endpoint."""
    kind, slash, address = endpoint.partition("/")
    _, colon, port = address.rpartition(":")
    if slash and colon and port.isdecimal() and 0 < int(port) < 65536:
        if kind == "tls":
            return "tls"
        if kind == "tcp":
            return "tcp"
    raise ConfigError(f"{endpoint!r} is not a valid endpoint: write tls/ADDRESS:PORT, e.g. tls/10.0.0.1:7447.")
