"""Lockstep: every component in one process on virtual time, repeatable to the bit for one seed."""

import asyncio
from pathlib import Path

from dlokit.communication import virtual_time
from dlokit.communication.clock import LoopClock
from dlokit.communication.host import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.decision.component import DecisionComponent
from dlokit.errors import DlokitError
from dlokit.system.build import COMPONENTS, Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.run_record import RunRecord
from dlokit.system.shaping import ShapeJob, Watcher, shape


def run_lockstep(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher) -> RunRecord:
    """Run a task in this process; Ctrl-C ends it with outcome `cancelled`."""
    return virtual_time.run(_run(config, job, folder, watch))


async def _run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher) -> RunRecord:
    clock, transport = LoopClock(), MemoryTransport()
    host = Host(transport, clock)
    wiring = Wiring(transport=transport, clock=clock, folder=folder, start_nodes_world=job.start_nodes_world)
    decision: DecisionComponent | None = None
    for name in COMPONENTS:
        if name == "viewer" and config.headless:
            continue
        component = build_component(name, config, wiring)
        if isinstance(component, DecisionComponent):
            decision = component
        host.add(component)
    assert decision is not None
    async with host:
        task = asyncio.create_task(shape(decision, transport, clock, config, job, watch))
        fault = asyncio.create_task(host.wait_failed())
        try:
            await asyncio.wait({task, fault}, return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                _raise_fault(fault)
            return task.result()
        except asyncio.CancelledError:
            # Ctrl-C: the task itself stops the robot, and ends with outcome `cancelled`.
            task.cancel()
            return await task
        finally:
            task.cancel()
            fault.cancel()
            await asyncio.gather(task, fault, return_exceptions=True)


def _raise_fault(fault: "asyncio.Task[None]") -> None:
    error = fault.exception()
    if error is not None:
        raise error
    raise DlokitError("a component ended without an error; this is a mistake of dlokit's")
