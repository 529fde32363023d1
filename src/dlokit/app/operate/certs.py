"""`dlokit certs`: a lab's certificate authority, and a key and certificate for each of its hosts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dlokit.app.commands import CliCommand
from dlokit.system.hosts.certificates import hosts_from_words, make_certificates
from dlokit.system.hosts.config import AUTHORITY


@dataclass(frozen=True, kw_only=True)
class CertsArgs:
    """Make the certificates with which the hosts of a run on several machines know one another.

    Try
      dlokit certs lab --hosts decision=10.0.0.1 robot viewer
      dlokit certs lab --hosts desk                      later: one more, of the same lab

    A host that others connect to needs its addresses: NAME=ADDRESS[,ADDRESS…], IP addresses or names. Keys that are
    there are never written again; a certificate is when its host has other addresses, or when it ends within a month.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Where the lab's keys lie. Whoever can read it can make hosts of this lab."""
    hosts: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME[=ADDRESS,…]")]
    """The hosts, each with the addresses at which others connect to it, if they do."""


def run(args: CertsArgs) -> int:
    """Write what is missing, and say what to copy where."""
    hosts = hosts_from_words(args.hosts)
    done = make_certificates(args.folder, hosts)
    for line in done or [f"{args.folder}: nothing to do, all of it is there"]:
        print(line)
    for host in hosts:
        files = " ".join(
            str(args.folder / name) for name in (f"{AUTHORITY}.pem", f"{host.name}.pem", f"{host.name}.key")
        )
        print(f"copy to host {host.name}: {files}")
    print(f"keep {args.folder / AUTHORITY}.key here: whoever has it can make hosts of this lab")
    return 0


COMMAND = CliCommand(CertsArgs, run)
