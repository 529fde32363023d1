"""Live: every process of the table at its own rate, over zenoh; the task runs in this one."""

import asyncio
import logging
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec

from dlokit.communication.container import Host
from dlokit.communication.zenoh.session import OpenSession, open_session
from dlokit.decision.component import DecisionComponent
from dlokit.description.arms import ARMS
from dlokit.errors import ProcessFailure
from dlokit.skills.planning.loading import load
from dlokit.system.build import Wiring, build_component, instances_of_run
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.lease_keeper import leases_held
from dlokit.system.live_system import LiveSystem, live_system, namespace_of, spread_system
from dlokit.system.processes import DECISION, processes_of_run
from dlokit.system.recording import live_recorder, with_calls_told
from dlokit.system.run_record import RunRecord
from dlokit.system.shaping import ShapeJob, Watcher, shape
from dlokit.system.start_file import NOBODYS_BUSINESS, write_start
from dlokit.system.supervisor import PROCESS, Launch
from dlokit.system.toml_config import to_toml
from dlokit.types.flow import RunOutcome

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Starting:
    """What a live run is made of; a bench may put something of its own in between."""

    command: tuple[str, ...] = PROCESS
    """Of every process but this one."""
    open_session: OpenSession = open_session
    """On the bus, of this one."""


AS_SHIPPED = Starting()


def run_live(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, starting: Starting = AS_SHIPPED
) -> RunRecord:
    """Run a task to its end; Ctrl-C ends it with outcome `cancelled`. Raises `ProcessFailure` when a process dies."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CONFIG_FILE).write_text(to_toml(config), encoding="utf-8")
    write_start(folder, job.start_nodes_world)
    return asyncio.run(_run(config, job, folder, watch, starting))


async def _run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, starting: Starting) -> RunRecord:
    rows = processes_of_run(simulated=True, watched=not config.headless, arms=config.arms)
    launch = Launch(
        namespace=namespace_of(folder),
        config_file=folder / CONFIG_FILE,
        run_dir=folder,
        instances=instances_of_run(config),
        command=starting.command,
    )
    loads = partial(load, config.planning.strategy)
    if config.hosts is None:
        system = live_system(rows, launch, starting.open_session, loads)
    else:
        system = spread_system(rows, launch, config.hosts, to_toml(config), log.warning, loads)
    async with system as live:
        with live_recorder(config, job.name, folder, live.clock, live.transport):
            return await live.run(_decide(live, config, job, folder, watch), _failed)


def _failed(record: RunRecord, failure: ProcessFailure) -> RunRecord:
    """The record of a task that a dead process ended."""
    log.error("%s", failure)
    result = msgspec.structs.replace(record.result, outcome=RunOutcome.FAILED, reason=failure.reason)
    return replace(record, result=result)


async def _decide(live: LiveSystem, config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher) -> RunRecord:
    transport = with_calls_told(live.transport, live.clock)
    wiring = Wiring(transport=transport, clock=live.clock, folder=folder, start_nodes_world=NOBODYS_BUSINESS)
    host = Host(transport, live.clock, live.compute, instances_of_run(config))
    components = {name: build_component(name, config, wiring) for name in DECISION.components}
    for component in components.values():
        host.add(component)
    decision = components["decision"]
    assert isinstance(decision, DecisionComponent)
    await host.prepare()
    async with host, leases_held(live.transport, live.clock, config.robot, ARMS[: config.arms]):
        return await shape(decision, transport, live.clock, config, job, watch)
