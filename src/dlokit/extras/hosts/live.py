"""Starts and watches the processes of a live system on several hosts, from its decision process."""

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

from dlokit.extras.hosts.config import HostsConfig
from dlokit.extras.hosts.placement import Placement, placed
from dlokit.extras.hosts.remote_processes import RemoteProcesses
from dlokit.extras.hosts.routers import NAMESPACE, limited_links, main_router_config
from dlokit.recording.disk import Disk
from dlokit.system.live_system import LiveSystem, all_seen, beginning
from dlokit.system.processes.bus import JoinedBus, join_bus
from dlokit.system.processes.freed_memory import freed_memory_returned
from dlokit.system.processes.running import announced
from dlokit.system.processes.sockets import local_bus
from dlokit.system.processes.supervisor import Launch, Supervisor
from dlokit.system.processes.workers import worker_pool
from dlokit.system.table import ProcessRow


@asynccontextmanager
async def spread_system(
    rows: tuple[ProcessRow, ...],
    launch: Launch,
    hosts: HostsConfig,
    config_toml: str,
    say: Callable[[str], None],
    meanwhile: Callable[[], object] | None,
    disk: Disk,
) -> AsyncGenerator[LiveSystem]:
    """As `live_system`, on several hosts; `dlokit host` starts the processes of the other hosts.

    `config_toml` is the configuration of all hosts. Raises `ConfigError` for invalid `hosts`, and `ProcessFailure`
    when a host is missing, or its processes do not start.
    """
    placement = placed(hosts, rows)
    own, *here = placement.own
    with (
        local_bus(NAMESPACE) as local,
        announced(launch.run_dir, local, client=True, time_base=own.time_base) as announcement,
        worker_pool() as compute,
        freed_memory_returned(),
    ):
        async with (
            join_bus(main_router_config(hosts, placement, local), own.time_base) as bus,
            limited_links(hosts.endpoint),
            beginning(compute, meanwhile),
            _shares(bus, placement, config_toml, hosts, say) as shares,
            Supervisor(tuple(here), launch, lambda _: local.client(), disk) as supervisor,
        ):
            await supervisor.guard(bus.first_tick())
            if not placement.clock_elsewhere:
                await supervisor.guard(shares.start())
            try:
                components = [name for row in rows[1:] for name in row.components]
                await supervisor.guard(all_seen(bus.transport, components))
                announcement.ready()
                yield LiveSystem(bus.transport, bus.clock, compute, supervisor, local.client(), disk, shares)
            finally:
                announcement.ending()
                await shares.end()


@asynccontextmanager
async def _shares(
    bus: JoinedBus, placement: Placement, config_toml: str, hosts: HostsConfig, say: Callable[[str], None]
) -> AsyncGenerator[RemoteProcesses]:
    """The processes on other hosts; started already if one of these hosts has the clock of the run."""
    shares = RemoteProcesses(bus.transport, placement.others, config_toml, hosts.wait_s, say)
    if placement.clock_elsewhere:
        await shares.start()
    try:
        yield shares
    finally:
        await shares.end()
