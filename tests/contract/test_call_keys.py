"""Calls over zenoh: the key alone names the skill, and one that was cancelled before its arrival does not run."""

import asyncio

import pytest
from buses import new_bus
from transport_grid import WAIT_S, eventually

from dlokit.communication.skill import SkillCall
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.communication.zenoh.session import open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.skills.robot import api
from dlokit.types.outcome import Cancelled, Outcome, Succeeded

pytestmark = pytest.mark.live


async def answer(key: str, cancelled: str = "") -> tuple[Outcome[None], list[SkillCall]]:
    """Outcome of call `id-1` of `robot.stop` through a key, after the call `cancelled` was cancelled, and what ran."""
    ran: list[SkillCall] = []

    async def handler(call: SkillCall, report: Report) -> bytes:
        ran.append(call)
        return codec.encode(Succeeded(result=None))

    request = api.STOP.request("id-1", "id")
    attachment = request.schema + request.call_id.encode()
    bus = new_bus()
    called, caller = ZenohTransport(bus.first()), ZenohTransport(bus.guest)
    session = open_session(bus.client())
    try:
        called.serve("robot", handler)
        assert await caller.wait_for("robot", WAIT_S)
        if cancelled:
            session.put("cancel/robot", cancelled.encode())
            # The call arrives in another thread, and must not overtake.
            early = called._servers["robot"]._cancelled_early  # pyright: ignore[reportPrivateUsage]
            await eventually(lambda: cancelled in early)
        replies = await asyncio.to_thread(
            lambda: list(session.get(key, payload=request.arguments, attachment=attachment, timeout=WAIT_S))
        )
        (reply,) = replies
        assert reply.ok is not None
        outcome = codec.decode(reply.ok.payload.to_bytes(), api.STOP.outcome_type)
        assert bool(ran) == isinstance(outcome, Succeeded)
        return outcome, ran
    finally:
        session.close()
        await caller.close()
        await called.close()


def test_the_key_alone_says_which_skill_is_called() -> None:
    """Access control checks only the key: a host that may only stop an arm must not move it through that key."""
    for key in ("stop", "recover", "*"):  # the last is the key of no skill
        outcome, (call,) = asyncio.run(answer(f"call/robot/{key}"))
        assert isinstance(outcome, Succeeded)
        assert (call.component, call.skill, call.call_id, call.caller) == ("robot", key, "id-1", "id")
        assert call.schema == api.STOP.schema


def test_a_call_cancelled_before_its_arrival_is_not_run_and_another_is() -> None:
    assert isinstance(asyncio.run(answer("call/robot/stop", cancelled="id-1"))[0], Cancelled)
    assert isinstance(asyncio.run(answer("call/robot/stop", cancelled="id-2"))[0], Succeeded)
