"""Lockstep: all components in one process on virtual time, repeatable to the bit for one seed."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import Clock, LoopClock
from dlokit.communication.timing.virtual_time import VirtualTimeLoop
from dlokit.communication.transport import Transport
from dlokit.decision.component import DecisionComponent
from dlokit.recording.call_log import CallLog
from dlokit.recording.disk import Disk
from dlokit.recording.recorder import Recorder
from dlokit.system.build import Build, Wiring, assemble, build_component, decision_of
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.processes.bus import CABLES
from dlokit.system.results.recording import lockstep_recorder
from dlokit.system.results.run_result import RunRecord
from dlokit.system.shaping import Watcher, shape, stopped_by_signals
from dlokit.system.table import components_of_run
from dlokit.types.arrays import Float64Array


@dataclass(frozen=True, kw_only=True)
class LockstepSystem:
    """A running system in this process: call its skills and read its topics through `transport`."""

    transport: Transport
    clock: Clock
    decision: DecisionComponent
    host: Container


@asynccontextmanager
async def lockstep_system(
    config: RunConfig,
    start_nodes_world: Float64Array,
    folder: Path | None,
    recorder: Recorder | None = None,
    build: Build = build_component,
    disk: Disk | None = None,
) -> AsyncGenerator[LockstepSystem, None]:
    """Start all components; for use under `virtual_time.run`.

    The cell places its DLO along `start_nodes_world` (K, 3) [m] and writes its ground truth to `folder`; None: it
    does not. `recorder` receives every message and call. `build` creates each component by its name, the cell first.
    """
    clock = LoopClock()
    transport = MemoryTransport()
    if recorder is not None:
        transport = MemoryTransport(recorder.put, CallLog(clock.now_ns, recorder.put, unlogged=CABLES))
    wiring = Wiring(
        transport=transport, clock=clock, folder=folder, start_nodes_world=start_nodes_world, disk=disk or Disk()
    )
    async with assemble(components_of_run(config), config, wiring, build=build) as host:
        yield LockstepSystem(transport=transport, clock=clock, decision=decision_of(host), host=host)


def run_lockstep(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, build: Build = build_component
) -> RunRecord:
    """Run a task in this process; Ctrl-C ends it with outcome `cancelled`."""
    disk = Disk()
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        record = runner.run(_run(config, job, folder, watch, build, disk))
    return replace(record, unwritten=disk.failures)


async def _run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, build: Build, disk: Disk) -> RunRecord:
    with stopped_by_signals(watch) as stop, lockstep_recorder(config, job.name, folder, LoopClock(), disk) as recorder:
        async with (
            lockstep_system(config, job.start_nodes_world, folder, recorder, build, disk) as system,
            system.host.guarded(),
        ):
            return await shape(system.host, config, job, watch, stop)
