"""`dlokit certs`: create a lab's certificate authority, and a key and certificate for each of its hosts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dlokit.app.commands import CliCommand
from dlokit.extras.hosts.certificates import hosts_from_words, make_certificates
from dlokit.extras.hosts.config import AUTHORITY


@dataclass(frozen=True, kw_only=True)
class CertsArgs:
    """Create the certificates with which the hosts of a multi-machine run authenticate one another.

    Try
      dlokit certs lab --hosts decision=10.0.0.1 robot viewer
      dlokit certs lab --hosts desk                      later: add a host to the same lab

    A host that accepts connections needs its addresses: NAME=ADDRESS[,ADDRESS…], IP addresses or names. Existing keys
    are never overwritten; a certificate is renewed when the addresses of its host change, or within a month of its end.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Folder with the keys of the lab. Anyone who can read it can create hosts of this lab."""
    hosts: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME[=ADDRESS,…]")]
    """The hosts, each with the addresses at which other hosts connect to it, if any."""


def run(args: CertsArgs) -> int:
    """Write the missing files, and print which files to copy to which host."""
    hosts = hosts_from_words(args.hosts)
    done = make_certificates(args.folder, hosts)
    for line in done or [f"{args.folder}: nothing to do, all files exist"]:
        print(line)
    for host in hosts:
        files = " ".join(
            str(args.folder / name) for name in (f"{AUTHORITY}.pem", f"{host.name}.pem", f"{host.name}.key")
        )
        print(f"copy to host {host.name}: {files}")
    print(f"keep {args.folder / AUTHORITY}.key here: anyone who has it can create hosts of this lab")
    return 0


COMMAND = CliCommand(CertsArgs, run)
