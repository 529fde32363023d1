"""A host of a lab, by its name."""

import ipaddress
import re
from dataclasses import dataclass

from dlokit.errors import InputError

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
