"""A started process waits for the components that it needs and for the first tick, and names what is missing."""

import asyncio
from collections.abc import Callable

import pytest

from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import SkillCall
from dlokit.communication.timing import virtual_time
from dlokit.communication.transport import Report
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import ProcessFailure
from dlokit.system.processes.bus import JoinedBus, clock_of, ticking
from dlokit.system.processes.child import dependencies_present
from dlokit.system.processes.child_process import ChildSpec
from dlokit.system.table import TimeBase
from dlokit.types.system import ClockTick

WITHIN_S = 60.0


async def answer(call: SkillCall, report: Report) -> bytes:
    return call.arguments


def wait_time_s(time_base: TimeBase, events: dict[float, Callable[[MemoryTransport], object]]) -> float:
    """Time for which a process with this clock waits for `cell`, while these events happen at these times [s]."""
    spec = ChildSpec(
        process="robot",
        components=(),
        bus=ZenohConfig(namespace="lamp"),
        time_base=time_base,
        config_file="",
        run_dir="",
        page_key="",
        beat_fd=-1,
        after=("cell",),
        others_within_s=WITHIN_S,
    )

    async def main() -> float:
        loop, transport, clock = asyncio.get_running_loop(), MemoryTransport(), clock_of(time_base)
        began_s = loop.time()
        for at_s, event in events.items():
            loop.call_later(at_s, event, transport)
        async with ticking(transport, clock, time_base):
            await dependencies_present(spec, JoinedBus(transport, clock))
        return loop.time() - began_s

    return virtual_time.run(main())


def serve(transport: MemoryTransport) -> None:
    transport.serve("cell", answer)


def tick(transport: MemoryTransport) -> None:
    transport.publish(topics.CLOCK, ClockTick(stamp_ns=1_000_000_000))


def test_a_process_waits_for_its_components_and_for_the_first_tick_of_the_cell() -> None:
    assert wait_time_s(TimeBase.MACHINE, {20.0: serve}) == pytest.approx(20.0)
    assert wait_time_s(TimeBase.CELL, {20.0: serve, 30.0: tick}) == pytest.approx(30.0)


def test_what_does_not_come_in_time_is_named() -> None:
    with pytest.raises(ProcessFailure, match="component_missing: cell: robot waited 60 s for it"):
        wait_time_s(TimeBase.MACHINE, {WITHIN_S + 1.0: serve})
    with pytest.raises(ProcessFailure, match="no_clock: no tick of the clock came within 60 s"):
        wait_time_s(TimeBase.CELL, {20.0: serve})
