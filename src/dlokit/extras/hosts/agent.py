"""The agent of one host in a multi-machine run: it starts and watches its processes on request of the main host."""

import asyncio
import logging
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import asynccontextmanager

from dlokit import __version__
from dlokit.communication.component import Component, implements, implements_reporting
from dlokit.communication.container import Container
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import InputError, ProcessFailure, SkillFailure, SkillRejected
from dlokit.extras.hosts.api import HELLO, RUN_SHARE, HostFacts, ShareReady
from dlokit.extras.hosts.placement import AGENT
from dlokit.extras.hosts.routers import NAMESPACE, limited_links
from dlokit.system.processes.bus import JoinBus, join_bus
from dlokit.system.processes.running import announced
from dlokit.system.processes.sockets import LocalBus, local_bus
from dlokit.system.processes.supervisor import Launch, Supervisor
from dlokit.system.table import ProcessRow, TimeBase

log = logging.getLogger(__name__)

Prepare = Callable[[str], tuple[Launch, Mapping[str, ProcessRow]]]
"""Prepares a run from its configuration: returns the launch, and its rows by name. Raises `InputError`."""


class HostAgent(Component):
    """Serves one host; it runs one set of processes at a time."""

    name = AGENT

    def __init__(
        self,
        name: str,
        prepare: Prepare,
        local: LocalBus,
        say: Callable[[str], None],
    ) -> None:
        """The processes of this host reach other hosts through its router at `local`."""
        super().__init__()
        self.instance = name
        self._prepare = prepare
        self._local = local
        self._say = say

    @implements(HELLO)
    async def hello(self) -> HostFacts:
        """Return the version and the time of day."""
        return HostFacts(version=__version__, wall_ns=time.time_ns())

    @implements_reporting(RUN_SHARE)
    async def run_share(
        self, report: Callable[[ShareReady], None], config_toml: str, processes: tuple[str, ...]
    ) -> None:
        """Run the processes until the caller cancels the call or disconnects."""
        try:
            launch, known = self._prepare(config_toml)
            rows = tuple(known[name] for name in processes)
        except (InputError, KeyError) as error:
            self._say(f"a run is rejected: {error}")
            raise SkillRejected("bad_configuration", str(error)) from error
        self._say(f"starting {', '.join(processes)}; logs in {launch.run_dir / 'logs'}")
        try:
            async with Supervisor(rows, launch, lambda _: self._local.client()) as supervisor:
                with announced(launch.run_dir, self._local, client=True):
                    self._say("ready")
                    report(ShareReady(host=self.instance))
                    await supervisor.wait_failed()
        except ProcessFailure as failure:
            self._say(str(failure))
            raise SkillFailure(failure.reason, failure.detail) from failure
        except InputError as error:
            self._say(str(error))
            raise SkillFailure("process_could_not_work", str(error)) from error
        finally:
            self._say("the processes have ended; waiting for the next run")


@asynccontextmanager
async def host_served(
    name: str,
    door: Callable[[LocalBus], ZenohConfig],
    prepare: Prepare,
    say: Callable[[str], None],
    join: JoinBus = join_bus,
) -> AsyncGenerator[None]:
    """Open this host's router and serve requests. Raises `MachineError` when this user has no folder for sockets."""
    with local_bus(NAMESPACE) as local:
        config = door(local)
        async with join(config, TimeBase.MACHINE) as bus, limited_links(config.connect[0]):
            host = Container(bus.transport, bus.clock)
            host.add(HostAgent(name, prepare, local, say))
            async with host:
                yield


async def serve_host(
    name: str,
    door: Callable[[LocalBus], ZenohConfig],
    prepare: Prepare,
    say: Callable[[str], None],
) -> None:
    """As `host_served`, until cancelled."""
    async with host_served(name, door, prepare, say):
        await asyncio.Event().wait()
