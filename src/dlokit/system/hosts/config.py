"""Which host of a lab runs which processes, where the hosts meet, and where their certificates lie."""

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from dlokit.errors import ConfigError, InputError

AUTHORITY = "ca"
"""Stem of the authority's files; no host may be called so."""

_NAME = re.compile(r"[a-z0-9]([a-z0-9-]{0,30}[a-z0-9])?")
_ADDRESS = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")


@dataclass(frozen=True, kw_only=True)
class LabHost:
    """A host of a lab: its name, and where others reach it."""

    name: str
    addresses: tuple[str, ...] = ()
    """IP addresses and names by which others connect to it; only a host that others connect to needs any."""

    def __post_init__(self) -> None:
        if self.name == AUTHORITY or not _NAME.fullmatch(self.name):
            raise InputError(
                f"{self.name!r} cannot name a host: allowed are up to 32 small letters, digits and -, "
                f"but not {AUTHORITY!r}."
            )
        for address in self.addresses:
            if not is_ip(address) and not _ADDRESS.fullmatch(address):
                raise InputError(f"{address!r} is neither an IP address nor the name of a machine.")


def is_ip(address: str) -> bool:
    """Whether it is an IP address, and no name."""
    try:
        ipaddress.ip_address(address)
    except ValueError:
        return False
    return True


Kind = Literal["tls", "tcp"]


@dataclass(frozen=True, kw_only=True)
class HostsConfig:
    """The part `[hosts]` of a configuration: a run on several machines."""

    endpoint: str
    """Where the host of the decision process listens and the others connect: `tls/10.0.0.1:7447`."""
    certificates: str = ""
    """Folder with `ca.pem`, and this host's certificate and key; what `dlokit certs` makes."""
    runs: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Host → processes, e.g. `decision = ["decision", "simulation", "observer"]`; each process on one host."""
    plain_tcp: bool = False
    """Allow an endpoint `tcp/…`: whoever reaches the port may then read everything and command the robot."""
    wait_s: float = 60.0
    """How long a run waits for its other hosts [s]."""

    def __post_init__(self) -> None:
        if kind_of(self.endpoint) == "tcp" and not self.plain_tcp:
            raise ConfigError(
                f"the hosts meet at {self.endpoint}, where whoever reaches the port could command the robot: use "
                "tls/… with certificates of `dlokit certs`, or say plain_tcp = true in [hosts]."
            )
        if kind_of(self.endpoint) == "tls" and not self.certificates:
            raise ConfigError(
                f"the hosts meet at {self.endpoint}, and [hosts] names no folder `certificates`: make one with "
                "`dlokit certs FOLDER --hosts …`."
            )
        if not 0.0 < self.wait_s < 86_400.0:
            raise ConfigError(f"wait_s in [hosts] is {self.wait_s}; it must be above 0, and less than a day.")
        for host in self.runs:
            LabHost(name=host)

    @property
    def folder(self) -> Path:
        """Of the certificates."""
        return Path(self.certificates).expanduser()


def kind_of(endpoint: str) -> Kind:
    """Whether the hosts meet by TLS. Raises `ConfigError` when it is no place to meet."""
    kind, slash, address = endpoint.partition("/")
    _, colon, port = address.rpartition(":")
    if slash and colon and port.isdecimal() and 0 < int(port) < 65536:
        if kind == "tls":
            return "tls"
        if kind == "tcp":
            return "tcp"
    raise ConfigError(f"{endpoint!r} is no place where hosts can meet: write tls/ADDRESS:PORT, e.g. tls/10.0.0.1:7447.")
