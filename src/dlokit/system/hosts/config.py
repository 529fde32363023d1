"""The section `[hosts]` of a configuration: which host runs which processes, endpoints and certificates."""

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from dlokit.errors import ConfigError, InputError

AUTHORITY = "ca"
"""File name of the authority without suffix; no host may have this name."""

_NAME = re.compile(r"[a-z0-9]([a-z0-9-]{0,30}[a-z0-9])?")
_ADDRESS = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")


@dataclass(frozen=True, kw_only=True)
class LabHost:
    """A host of a lab: its name, and where others reach it."""

    name: str
    addresses: tuple[str, ...] = ()
    """IP addresses and names by which others connect to it; empty if none do."""

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
    """Endpoint on which the host of the decision process listens and to which others connect: `tls/10.0.0.1:7447`."""
    certificates: str = ""
    """Folder with `ca.pem` and this host's certificate and key, created by `dlokit certs`."""
    runs: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Host → processes, e.g. `decision = ["decision", "simulation", "observer"]`; each process on one host."""
    plain_tcp: bool = False
    """Allow an endpoint `tcp/…`: anyone who reaches the port can then read all data and command the robot."""
    wait_s: float = 60.0
    """Time for which a run waits for its other hosts [s]."""

    def __post_init__(self) -> None:
        if kind_of(self.endpoint) == "tcp" and not self.plain_tcp:
            raise ConfigError(
                f"the hosts' endpoint is {self.endpoint}; anyone who reaches the port could command the robot: use "
                "tls/… with certificates of `dlokit certs`, or set plain_tcp = true in [hosts]."
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


def kind_of(endpoint: str) -> Kind:
    """Whether the endpoint uses TLS. Raises `ConfigError` when it is no valid endpoint."""
    kind, slash, address = endpoint.partition("/")
    _, colon, port = address.rpartition(":")
    if slash and colon and port.isdecimal() and 0 < int(port) < 65536:
        if kind == "tls":
            return "tls"
        if kind == "tcp":
            return "tcp"
    raise ConfigError(f"{endpoint!r} is not a valid endpoint: write tls/ADDRESS:PORT, e.g. tls/10.0.0.1:7447.")
