"""The display of a run is notified while a person's stop is latched in an arm."""

import asyncio

import msgspec
from made_states import ARM_AT_REST

from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.system.shaping import Watcher, stops_watched


class Told(Watcher):
    def __init__(self) -> None:
        self.stopped: list[bool] = []

    def arms_stopped(self, stopped: bool) -> None:
        self.stopped.append(stopped)


def test_a_stop_is_told_once_until_every_arm_is_enabled() -> None:
    async def main() -> list[bool]:
        bus, watch = MemoryTransport(), Told()

        async def publish(robot: str, *, latched: bool) -> None:
            bus.publish(topics.ROBOT_STATE, msgspec.structs.replace(ARM_AT_REST, robot=robot, stop_latched=latched))
            await asyncio.sleep(0.1)

        await publish("first", latched=True)  # before anybody watched
        async with stops_watched(bus, watch):
            for latched in (True, True, False):
                await publish("first", latched=latched)
                await publish("second", latched=True)
            await publish("second", latched=False)
        return watch.stopped

    assert virtual_time.run(main()) == [True, False]


def test_a_run_whose_arms_nobody_stops_is_told_nothing() -> None:
    async def main() -> list[bool]:
        bus, watch = MemoryTransport(), Told()
        async with stops_watched(bus, watch):
            bus.publish(topics.ROBOT_STATE, ARM_AT_REST)
            await asyncio.sleep(0.1)
        return watch.stopped

    assert virtual_time.run(main()) == []
