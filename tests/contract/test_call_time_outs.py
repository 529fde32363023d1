"""How long zenoh keeps a call: as long as its caller may wait. It keeps a part of each query until its time-out."""

import asyncio
from typing import Any

import zenoh
from buses import new_bus

from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.communication.zenoh.session import ZenohConfig, open_session
from dlokit.communication.zenoh.transport import CALL_MARGIN_S, CANCEL_TIMEOUT_S, SLOWEST_CLOCK, ZenohTransport
from dlokit.skills.robot import api
from dlokit.types.outcome import Succeeded


class Watched:
    """A session whose queries are noted."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self.limits_s: dict[str, float] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def get(self, key: str, *args: Any, timeout: float, **kwargs: Any) -> Any:
        self.limits_s[key] = timeout
        return self._session.get(key, *args, timeout=timeout, **kwargs)


def test_zenoh_keeps_a_call_as_long_as_its_caller_waits_and_no_longer() -> None:
    opened: list[Watched] = []

    def watched(config: ZenohConfig) -> Any:
        opened.append(Watched(open_session(config)))
        return opened[-1]

    async def handler(request: bytes, report: Report) -> bytes:
        return codec.encode(Succeeded(result=None))

    async def main() -> None:
        bus = new_bus()
        called, caller = ZenohTransport(bus.first()), ZenohTransport(bus.guest, open_session=watched)
        try:
            called.serve("robot", handler)
            assert await caller.wait_for("robot", 30.0)
            assert isinstance(await caller.call(api.STOP), Succeeded)
        finally:
            await caller.close()
            await called.close()

    asyncio.run(main())
    longest_s = SLOWEST_CLOCK * (api.STOP.timeout_s + CALL_MARGIN_S)
    assert longest_s < opened[0].limits_s["call/robot/stop"] <= longest_s + CANCEL_TIMEOUT_S
