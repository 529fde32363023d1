"""A disturbed bus: delayed messages in order, no feedback, and only after the disturbance begins."""

import asyncio
import threading
import time
from collections.abc import Callable
from pathlib import Path

from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.communication import topics
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.description.arm.franka import PANDA
from dlokit.geometry import downward
from dlokit.types.robot import RobotState
from dlokit.types.system import ClockTick
from parts.faults import disturbance
from parts.faults.disturbance import FILE_NAME, Disturbance, Line, disturb, disturbed_by, kind_in


def test_an_undisturbed_bus_delivers_everything_at_once(tmp_path: Path) -> None:
    line = Line(tmp_path / FILE_NAME)
    sent: list[int] = []
    line.send(lambda: sent.append(1))
    assert sent == [1]
    assert kind_in(tmp_path / FILE_NAME) is Disturbance.NONE


def test_late_messages_keep_their_order_after_the_disturbance(tmp_path: Path) -> None:
    disturb(tmp_path, Disturbance.LATE)
    line = Line(tmp_path / FILE_NAME)
    arrived, arrived_s, last = list[int](), list[float](), threading.Event()
    sent_s = time.monotonic()
    line.send(lambda: (arrived.append(1), arrived_s.append(time.monotonic())))
    disturb(tmp_path, Disturbance.NONE)
    threading.Event().wait(2 * disturbance.LOOK_EVERY_S)  # until the line has looked again
    line.send(lambda: (arrived.append(2), last.set()))
    assert last.wait(60.0)
    assert arrived == [1, 2]
    assert arrived_s[0] - sent_s >= disturbance.LATE_S


def arm_state(stamp_ns: int) -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        stamp_ns=stamp_ns,
        q_rad=PANDA.home_q_rad,
        T_world_tcp=downward([0.3, 0.0, 0.4], 0.0),
        finger_width_m=0.0,
    )


async def until(said: Callable[[], None], there: Callable[[], bool]) -> None:
    """Publish repeatedly until it arrives."""
    async with asyncio.timeout(60.0):
        while not there():
            said()
            await asyncio.sleep(0.01)


def test_withheld_feedback_reaches_neither_a_reader_nor_a_tap(tmp_path: Path) -> None:
    async def main() -> None:
        where = f"unixsock-stream/{tmp_path}/bus"
        arm = ZenohTransport(ZenohConfig(namespace="withheld", listen=(where,)))
        reads = ZenohConfig(namespace="withheld", listen=(), connect=(where,))
        driver = ZenohTransport(reads, open_session=disturbed_by(tmp_path / FILE_NAME))
        tapped: list[bytes] = []
        driver.tap(topics.ARM_STATE, tapped.append)

        def stamp_ns() -> int:
            newest = driver.latest(topics.ARM_STATE).value
            return 0 if newest is None else newest.stamp_ns

        def clock_ns() -> int:
            newest = driver.latest(topics.CLOCK).value
            return 0 if newest is None else newest.stamp_ns

        try:
            await until(lambda: arm.publish(topics.ARM_STATE, arm_state(1)), lambda: stamp_ns() == 1 and bool(tapped))
            disturb(tmp_path, Disturbance.NO_FEEDBACK)
            await asyncio.sleep(2 * disturbance.LOOK_EVERY_S)  # until the line has looked again
            tapped.clear()
            for _ in range(10):
                arm.publish(topics.ARM_STATE, arm_state(2))
            # All other messages arrive later on the same link.
            await until(lambda: arm.publish(topics.CLOCK, ClockTick(stamp_ns=2)), lambda: clock_ns() == 2)
            assert stamp_ns() == 1
            assert tapped == []
            disturb(tmp_path, Disturbance.NONE)
            await until(lambda: arm.publish(topics.ARM_STATE, arm_state(3)), lambda: stamp_ns() == 3 and bool(tapped))
        finally:
            await driver.close()
            await arm.close()

    asyncio.run(main())
