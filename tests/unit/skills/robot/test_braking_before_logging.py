"""A log line that blocks or raises cannot keep an arm moving: the brake command comes first."""

import asyncio
import logging
from collections.abc import Callable, Generator
from contextlib import contextmanager
from unittest.mock import MagicMock

import pytest
from robot_bench import PerfectArm, reason

from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh import calls
from dlokit.description.installation import Installation
from dlokit.skills.robot import api, component
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.skills.robot.neighbours import Neighbours
from dlokit.types.robot import RobotReason


@contextmanager
def before_each_line(log: logging.Logger, look: Callable[[], None], *, raises: bool) -> Generator[None]:
    """Call `look` when a line is logged, at the moment at which a handler could block."""

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            look()
            if raises:
                raise OSError("no space left on device")

    handler = Handler()
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


@pytest.mark.parametrize("raises", [False, True], ids=["blocks", "raises"])
def test_an_arm_that_comes_too_near_brakes_before_the_log_line(monkeypatch: pytest.MonkeyPatch, raises: bool) -> None:
    def too_near(self: Neighbours, state: object) -> str:
        return "0.02 m apart"

    monkeypatch.setattr(Neighbours, "too_near", too_near)
    arm, stops = PerfectArm(), list[int]()

    async def main() -> None:
        transport, clock = MemoryTransport(), LoopClock()
        host = Container(transport, clock)
        host.add(RobotComponent(RobotConfig(), arm, lambda: 0, neighbours=Installation().mounts(2)[1:]))
        async with host:
            port = Port(transport, clock, InlineCompute(), owner="test", publishes=())
            outcome = await port.call(api.GRASP)
            # A component whose log raises ends, and no arm executes its brake command here.
            assert raises or reason(outcome) == RobotReason.ARMS_TOO_NEAR
            await asyncio.sleep(1.0)

    with before_each_line(component.log, lambda: stops.append(arm.stops), raises=raises):
        virtual_time.run(main())
    assert stops == [1]


@pytest.mark.parametrize("raises", [False, True], ids=["blocks", "raises"])
def test_the_motions_of_a_lost_caller_have_ended_before_the_log_line(raises: bool) -> None:
    braked: list[str] = []
    lines: list[int] = []

    async def motion(arm: str) -> bytes:
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0.3)  # until it is at rest
            braked.append(arm)
        return b""

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)  # the handler of the log raises
        server = calls.CallServer(MagicMock(), "robot", MagicMock(), b"", MagicMock())
        tasks = {f"dead-{arm}": asyncio.create_task(motion(arm)) for arm in ("one", "two")}
        server._tasks.update(tasks)  # pyright: ignore[reportPrivateUsage]  # else it takes a network
        await asyncio.sleep(0.1)
        server.cancel_all_of("dead")
        assert lines == []  # nothing that may block precedes the end of this turn of the loop
        await asyncio.wait(tasks.values())
        await asyncio.sleep(0.0)

    with before_each_line(calls.log, lambda: lines.append(len(braked)), raises=raises):
        virtual_time.run(main())
    assert braked == ["one", "two"]
    assert len(lines) == 2
    assert all(lines)
