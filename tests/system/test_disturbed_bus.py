"""Two sessions of a bus whose messages are altered now and then: what is carried out is what was asked for, once."""

import asyncio
from pathlib import Path

import pytest

from dlokit.bench.faults import disturbance
from dlokit.bench.faults.disturbance import FILE_NAME, Disturbance, disturb, disturbed_by
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.skill import Skill
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.system.live import namespace_of
from dlokit.types.outcome import Succeeded

pytestmark = pytest.mark.system

CALLS = 100
WAIT_S = 60.0


def _add(value: int) -> int:
    """The sum of all values so far."""
    ...


ADD = Skill("adder", "add", _add, timeout_s=20.0)


class Adder(Component):
    name = "adder"

    def __init__(self) -> None:
        super().__init__()
        self.total = 0

    @implements(ADD)
    async def add(self, value: int) -> int:
        self.total += value
        return self.total


def test_every_call_runs_once_with_what_it_was_sent_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # A call fails when it, or its answer, is altered five times in a row: once in ten thousand calls.
    monkeypatch.setattr(disturbance, "ALTERED", 0.08)
    disturb(tmp_path, Disturbance.ALTERED)

    async def main() -> None:
        meeting_point = ("tcp/127.0.0.1:0",)
        opening = disturbed_by(tmp_path / FILE_NAME, seed=3)
        namespace = namespace_of(tmp_path)
        serving = ZenohTransport(
            ZenohConfig(namespace=namespace, listen=meeting_point, multicast_interface="lo"), open_session=opening
        )
        calling = ZenohTransport(
            ZenohConfig(namespace=namespace, listen=meeting_point, multicast_interface="lo"), open_session=opening
        )
        try:
            host, adder = Container(serving, LoopClock()), Adder()
            host.add(adder)
            async with host:
                assert await calling.wait_for("adder", WAIT_S)
                for number in range(1, CALLS + 1):
                    added = await calling.call(ADD, number)
                    assert isinstance(added, Succeeded)
                    assert added.result == number * (number + 1) // 2
        finally:
            await calling.close()
            await serving.close()

    asyncio.run(main())
    assert "altered on its way" in caplog.text
