"""Calls over zenoh: one whose key names another skill, or that was cancelled before its arrival, does not run."""

import asyncio

import pytest
from buses import new_bus
from transport_grid import WAIT_S, eventually

from dlokit.communication.calls import encode_call
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.communication.zenoh.session import open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.skills.robot import api
from dlokit.types.outcome import Cancelled, Outcome, Rejected, Succeeded

pytestmark = pytest.mark.live


async def answer(key: str, cancelled: str = "") -> Outcome[None]:
    """Outcome of call `id-1` of `robot.stop` through a key, after the call `cancelled` was cancelled."""
    ran: list[bytes] = []

    async def handler(request: bytes, report: Report) -> bytes:
        ran.append(request)
        return codec.encode(Succeeded(result=None))

    bus = new_bus()
    called, caller = ZenohTransport(bus.first()), ZenohTransport(bus.guest)
    session = open_session(bus.client())
    try:
        called.serve("robot", handler)
        assert await caller.wait_for("robot", WAIT_S)
        request = encode_call(api.STOP, "id-1", caller.identity)
        assert isinstance(request, bytes)
        if cancelled:
            session.put("cancel/robot", cancelled.encode())
            # The call arrives in another thread, and must not overtake.
            early = called._servers["robot"]._cancelled_early  # pyright: ignore[reportPrivateUsage]
            await eventually(lambda: cancelled in early)
        replies = await asyncio.to_thread(
            lambda: list(session.get(key, payload=request, attachment=b"id-1", timeout=WAIT_S))
        )
        (reply,) = replies
        assert reply.ok is not None
        outcome = codec.decode(reply.ok.payload.to_bytes(), api.STOP.outcome_type)
        assert bool(ran) == isinstance(outcome, Succeeded)
        return outcome
    finally:
        session.close()
        await caller.close()
        await called.close()


def test_a_call_by_the_key_of_another_skill_is_not_run() -> None:
    assert isinstance(asyncio.run(answer("call/robot/stop")), Succeeded)
    for key in ("call/robot/recover", "call/robot/*"):
        outcome = asyncio.run(answer(key))
        assert isinstance(outcome, Rejected)
        assert outcome.reason == "wrong_key"


def test_a_call_cancelled_before_its_arrival_is_not_run_and_another_is() -> None:
    assert isinstance(asyncio.run(answer("call/robot/stop", cancelled="id-1")), Cancelled)
    assert isinstance(asyncio.run(answer("call/robot/stop", cancelled="id-2")), Succeeded)
