"""The ideal perception and observer: exact, in the observer's own order of nodes, and on the bus like any other."""

import asyncio

import numpy as np
import pytest

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description import shapes
from dlokit.extras.bench.shaping.oracle import OracleObserver, OraclePerception
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.types.dlo import TargetPoints
from dlokit.types.outcome import Succeeded

TRUTH = shapes.builtin_shape("S", 0.5, 41)  # from -y to +y
NODES = 31


class _Rope:
    def __init__(self) -> None:
        self.nodes = TRUTH


async def _host(rope: _Rope) -> Container:
    host = Container(MemoryTransport(), LoopClock())
    host.add(OraclePerception(lambda: rope.nodes))
    host.add(OracleObserver(lambda: rope.nodes, nodes=NODES))
    return host


async def _targets(host: Container, towards: np.ndarray | None = None) -> TargetPoints:
    found = await host.transport.call(observer.INITIALISE, 0, towards)
    assert isinstance(found, Succeeded)
    return found.result


def test_targets_are_the_truth_with_the_left_end_first() -> None:
    async def main() -> TargetPoints:
        async with await _host(_Rope()) as host:
            return await _targets(host)

    targets = virtual_time.run(main())

    assert np.allclose(targets.nodes_world, geometry.resample(TRUTH, NODES)[::-1])
    assert targets.visible.all()


def test_the_order_is_the_requested_one_and_stays_when_the_rope_moves() -> None:
    moved = shapes.moved(TRUTH, (0.0, 0.02))

    async def main() -> TargetPoints:
        rope = _Rope()
        async with await _host(rope) as host:
            await _targets(host, TRUTH)
            rope.nodes = moved[::-1]  # whatever order the cell has
            stream = host.transport.stream(topics.TARGETS)
            await host.clock.sleep(0.1)
            await host.transport.call(perception.LOOK)
            return await anext(stream)

    assert np.allclose(virtual_time.run(main()).nodes_world, geometry.resample(moved, NODES), atol=1e-6)


def test_it_observes_at_the_tracking_rate_only_while_tracking() -> None:
    async def main() -> tuple[int, int]:
        async with await _host(_Rope()) as host:
            seen: list[int] = []

            async def count() -> None:
                async for look in host.transport.stream(topics.OBSERVATION):
                    seen.append(look.stamp_ns)  # noqa: PERF401 - an endless stream

            counting = asyncio.create_task(count())
            await host.transport.call(perception.SET_TRACKING, 10.0)
            await host.clock.sleep(1.05)
            await host.transport.call(perception.SET_TRACKING, 0.0)
            during = len(seen)
            await host.clock.sleep(2.0)
            counting.cancel()
            return during, len(seen)

    during, after = virtual_time.run(main())
    assert during == pytest.approx(11, abs=1)
    assert after <= during + 1  # the running observation
