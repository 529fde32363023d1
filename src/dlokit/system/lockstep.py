"""Lockstep: all components in one process on virtual time, repeatable to the bit for one seed."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from dlokit.communication.container import Container, end_tasks
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import Clock, LoopClock
from dlokit.communication.transport import Transport
from dlokit.decision.component import DecisionComponent
from dlokit.errors import DlokitError
from dlokit.recording.call_log import CallLog
from dlokit.recording.disk import Disk
from dlokit.recording.recorder import Recorder
from dlokit.system.build import Build, Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.results.recording import CABLES, lockstep_recorder
from dlokit.system.results.run_record import RunRecord
from dlokit.system.shaping import ShapeJob, Stop, Watcher, shape, until_stopped
from dlokit.system.table import components_of_run, instances_of_run
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
    host = Container(transport, clock, instances=instances_of_run(config))
    wiring = Wiring(
        transport=transport, clock=clock, folder=folder, start_nodes_world=start_nodes_world, disk=disk or Disk()
    )
    components = {name: build(name, config, wiring) for name in components_of_run(config)}
    for component in components.values():
        host.add(component)
    decision = components["decision"]
    assert isinstance(decision, DecisionComponent)
    async with host:
        yield LockstepSystem(transport=transport, clock=clock, decision=decision, host=host)


def run_lockstep(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, build: Build = build_component
) -> RunRecord:
    """Run a task in this process; Ctrl-C ends it with outcome `cancelled`."""
    disk = Disk()
    record = virtual_time.run(_run(config, job, folder, watch, build, disk))
    return replace(record, unwritten=disk.failures)


async def _run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, build: Build, disk: Disk) -> RunRecord:
    async def run(stop: Stop) -> RunRecord:
        with lockstep_recorder(config, job.name, folder, LoopClock(), disk) as recorder:
            async with lockstep_system(config, job.start_nodes_world, folder, recorder, build, disk) as system:
                return await _shaped(system, config, job, watch, stop)

    return await until_stopped(run, config, job, watch)


async def _shaped(system: LockstepSystem, config: RunConfig, job: ShapeJob, watch: Watcher, stop: Stop) -> RunRecord:
    work = shape(system.decision, system.transport, system.clock, config, job, watch, stop)
    task = asyncio.create_task(work)
    fault = asyncio.create_task(system.host.wait_failed())
    try:
        await asyncio.wait({task, fault}, return_when=asyncio.FIRST_COMPLETED)
        if not task.done():
            raise fault.exception() or DlokitError("a component ended early without an error")
        return task.result()
    except asyncio.CancelledError:
        # Ctrl-C: the task itself stops the robot, and ends with outcome `cancelled`.
        task.cancel()
        return await task
    finally:
        await end_tasks(task, fault)
