"""`dlokit host`: run the processes assigned to this machine in multi-machine runs."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from dlokit.app.commands import CliCommand, flag
from dlokit.errors import ConfigError
from dlokit.extras.hosts.agent import serve_host
from dlokit.extras.hosts.config import HostsConfig
from dlokit.extras.hosts.placement import main_host, placed
from dlokit.extras.hosts.routers import NAMESPACE, host_router_config
from dlokit.extras.hosts.section import section_of
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import from_toml, read_toml
from dlokit.system.processes.supervisor import Launch
from dlokit.system.results.run_folder import run_folder
from dlokit.system.table import ProcessRow, processes_of_run

MAIN = "decision"


@dataclass(frozen=True, kw_only=True)
class HostArgs:
    """Run the processes assigned to this machine in multi-machine runs, until Ctrl-C.

    Try
      dlokit host robot --connect tls/10.0.0.1:7447 --certificates lab
      dlokit host robot --config lab.toml

    The host of the decision process starts the run with `dlokit shape --runtime live --config lab.toml`, which
    determines the processes that run here and their configuration. Exit code: 2 bad input, 130 Ctrl-C.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """Name of this host, as in its certificate."""
    config: Annotated[Path | None, flag("FILE")] = None
    """A configuration with a section [hosts]; the following flags override it."""
    connect: Annotated[str | None, flag("ENDPOINT")] = None
    """Endpoint on which the host of the decision process listens: tls/ADDRESS:PORT."""
    certificates: Annotated[Path | None, flag("FOLDER")] = None
    """Folder with ca.pem, NAME.pem and NAME.key."""
    main: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint=f"(default: {MAIN})")] = None
    """Name of the host that may command this one."""


def run(args: HostArgs) -> int:
    """Connect, and serve runs until Ctrl-C."""
    hosts, main = hosts_of(args)
    if args.name == main:
        raise ConfigError(f"{main} is the host of the decision process: start the run there, with dlokit shape.")
    _say(f"host {args.name}: {main} is at {hosts.endpoint}; Ctrl-C ends this")
    door = partial(host_router_config, hosts, args.name, main)
    asyncio.run(serve_host(args.name, door, partial(_prepare, args.name), _say))
    return 0


def hosts_of(args: HostArgs) -> tuple[HostsConfig, str]:
    """Where to connect, and the name of the host there. Raises `ConfigError`."""
    written = None
    if args.config is not None:
        written = section_of(read_toml(args.config, RunConfig))
        if written is None:
            raise ConfigError(f"{args.config} has no section [hosts]: name a file that has one, or use --connect.")
        if args.name not in written.runs:
            raise ConfigError(
                f"[hosts.runs] in {args.config} has no host {args.name!r}; it has {', '.join(written.runs)}."
            )
    endpoint = args.connect or (written.endpoint if written else None)
    if endpoint is None:
        raise ConfigError("the endpoint is missing: give --connect tls/ADDRESS:PORT, or --config FILE with [hosts].")
    folder = str(args.certificates) if args.certificates else (written.certificates if written else "")
    password = written.password_file if written else ""
    hosts = HostsConfig(endpoint=endpoint, certificates=folder, password_file=password)
    return hosts, args.main or (main_host(written) if written else MAIN)


def _prepare(name: str, config_toml: str) -> tuple[Launch, Mapping[str, ProcessRow]]:
    """Create the folder of a run on this host, with the received configuration; and the rows of this host."""
    config = from_toml(config_toml, RunConfig, "the configuration of the run")
    hosts = section_of(config)
    if hosts is None:
        raise ConfigError("the configuration of the run has no section [hosts].")
    rows = placed(hosts, processes_of_run(config)).others.get(name, ())
    folder = run_folder(None, f"host {name}")
    (folder / CONFIG_FILE).write_text(config_toml, encoding="utf-8")
    launch = Launch(namespace=NAMESPACE, config_file=folder / CONFIG_FILE, run_dir=folder)
    return launch, {row.name: row for row in rows}


def _say(text: str) -> None:
    print(f"{datetime.now():%H:%M:%S} {text}", flush=True)


COMMAND = CliCommand(HostArgs, run)
