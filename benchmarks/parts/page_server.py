"""A viewer that draws a cloud at a rate, in a process of its own. Arguments: points of the cloud, and its rate [1/s].

Prints the address of the page; ends when its standard input is closed, and prints the seconds of computing time that
it took since the first line on its standard input, and the clouds that it received, as JSON.
"""

import asyncio
import json
import sys
import time

import numpy as np

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.build import build_viewer
from dlokit.system.config import RunConfig
from dlokit.types.observation import Observation


async def serve(points: int, rate_hz: float) -> None:
    """Publish clouds until the input is closed."""
    bus, clock = MemoryTransport(), LoopClock()
    host = Container(bus, clock)
    viewer = build_viewer(RunConfig(viewer=ViewerConfig(port=0)), operated=False)
    host.add(viewer)
    clouds = np.random.default_rng(0).uniform(0.0, 0.5, (8, points, 3)).astype(np.float32)
    async with host:
        await viewer.opened.wait()
        print(viewer.url, flush=True)
        publishing = asyncio.create_task(_publish(bus, clock, clouds, rate_hz))
        await asyncio.to_thread(sys.stdin.readline)
        began_s, cpu_s = time.monotonic(), time.process_time()
        await asyncio.to_thread(sys.stdin.read)
        took = {"wall_s": time.monotonic() - began_s, "cpu_s": time.process_time() - cpu_s}
        publishing.cancel()
        print(json.dumps(took), flush=True)


async def _publish(bus: MemoryTransport, clock: LoopClock, clouds: np.ndarray, rate_hz: float) -> None:
    began_ns, number = clock.now_ns(), 0
    while True:
        number += 1
        await clock.sleep_until(began_ns + round(number / rate_hz * 1e9))
        bus.publish(topics.OBSERVATION, Observation(stamp_ns=number, points_world=clouds[number % len(clouds)]))


if __name__ == "__main__":
    asyncio.run(serve(int(sys.argv[1]), float(sys.argv[2])))
