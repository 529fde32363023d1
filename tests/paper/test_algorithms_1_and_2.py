"""Algorithms 1 (caller) and 2 (component) of the paper, branch by branch, on every transport.

Algorithm 1: serialize the arguments, message = (component, skill, serialized arguments), send; success, or failure
on a connection error. Algorithm 2: receive; if the component is this one and the skill is one it has, unserialize
and run it: success, else failure; a skill error or a connection error is failure, never a crash.
"""

import asyncio
import itertools
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest
from buses import new_bus

from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill, SkillCall
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.transport import CallHandler, Report, Transport
from dlokit.communication.wire import codec
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded, Unreachable

LIMIT_S = 60.0  # a call takes a millisecond; only a broken bus needs more than this


def _grip(width_m: float, force_n: float = 20.0) -> float:
    """Close the fingers; returns the width."""
    ...


def _any_text(text: str) -> str:
    """Anything."""
    ...


GRIP = Skill("gripper", "grip", _grip, timeout_s=5.0)
SLIP = Skill("gripper", "slip", _grip, timeout_s=5.0)
REFUSE = Skill("gripper", "refuse", _grip, timeout_s=5.0)
BREAK = Skill("gripper", "break", _grip, timeout_s=5.0)
BABBLE = Skill("gripper", "babble", _grip, timeout_s=5.0)
NOT_A_SKILL_OF_IT = Skill("gripper", "fly", _grip, timeout_s=5.0)
OTHER_ARGUMENTS = Skill("gripper", "grip", _any_text, timeout_s=5.0)


class Gripper(Component):
    name = "gripper"

    def __init__(self) -> None:
        self.executed: list[tuple[float, float]] = []

    @implements(GRIP)
    async def grip(self, width_m: float, force_n: float = 20.0) -> float:
        self.executed.append((width_m, force_n))
        return width_m / 2.0

    @implements(SLIP)
    async def slip(self, width_m: float, force_n: float = 20.0) -> float:
        raise SkillFailure("slipped", "nothing is held")

    @implements(REFUSE)
    async def refuse(self, width_m: float, force_n: float = 20.0) -> float:
        raise SkillRejected("moving", "the arm moves")

    @implements(BREAK)
    async def break_down(self, width_m: float, force_n: float = 20.0) -> float:
        raise ZeroDivisionError("division by zero")

    @implements(BABBLE)
    async def babble(self, width_m: float, force_n: float = 20.0) -> float:
        return "no number"  # pyright: ignore[reportReturnType] - what a component in another language may do


@dataclass
class Lab:
    caller: Transport
    gripper: Gripper
    received: list[SkillCall]
    deliver: CallHandler
    """Passes a call to the gripper as it arrives from the bus."""


@asynccontextmanager
async def lab(caller: Transport, called: Transport) -> AsyncGenerator[Lab]:
    received: list[SkillCall] = []
    handlers: list[CallHandler] = []
    serve = called.serve

    def serve_and_note(component: str, handler: CallHandler) -> None:
        async def noting(call: SkillCall, report: Report) -> bytes:
            received.append(call)
            return await handler(call, report)

        handlers.append(handler)
        serve(component, noting)

    host = Container(called, LoopClock())
    gripper = Gripper()
    host.add(gripper)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(called, "serve", serve_and_note)
        async with host:
            yield Lab(caller, gripper, received, handlers[0])
    await caller.close()
    await called.close()


Body = Callable[[Lab], Awaitable[None]]
Bus = Callable[[Body], None]
numbers = itertools.count()


def in_memory(body: Body) -> None:
    async def main() -> None:
        bus = MemoryTransport()
        async with asyncio.timeout(LIMIT_S), lab(bus, bus) as it:
            await body(it)

    virtual_time.run(main())


def over_zenoh(body: Body) -> None:
    async def main() -> None:
        bus = new_bus()
        caller, called = ZenohTransport(bus.first()), ZenohTransport(bus.guest)
        async with asyncio.timeout(LIMIT_S), lab(caller, called) as it:
            assert await caller.wait_for("gripper", LIMIT_S)
            await body(it)

    asyncio.run(main())


@pytest.fixture(
    params=[pytest.param(in_memory, id="memory"), pytest.param(over_zenoh, id="zenoh", marks=pytest.mark.live)]
)
def on_bus(request: pytest.FixtureRequest) -> Bus:
    return request.param


def test_algorithm_1_sends_component_skill_and_serialized_arguments(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        await it.caller.call(GRIP, 0.04)
        (call,) = it.received
        assert (call.component, call.skill) == ("gripper", "grip")
        assert msgspec.msgpack.decode(call.arguments) == {"width_m": 0.04, "force_n": 20.0}

    on_bus(body)


def test_algorithm_1_a_call_that_was_sent_received_and_executed_is_a_success(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        outcome = await it.caller.call(GRIP, 0.04, force_n=5.0)
        assert isinstance(outcome, Succeeded)
        assert outcome.result == 0.02
        assert it.gripper.executed == [(0.04, 5.0)]

    on_bus(body)


def test_algorithm_1_arguments_that_cannot_be_serialized_are_a_failure_and_nothing_is_sent(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        unsendable = object()
        outcome = await it.caller.call(GRIP, unsendable)  # pyright: ignore[reportArgumentType] - on purpose
        assert is_rejected(outcome, "bad_arguments")
        outcome = await it.caller.call(GRIP, 0.04, 5.0, 6.0)  # pyright: ignore[reportCallIssue] - on purpose
        assert is_rejected(outcome, "bad_arguments")
        assert not it.received

    on_bus(body)


def test_algorithm_1_a_connection_error_is_a_failure_that_names_the_component(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        nobody = Skill("conveyor", "move", _grip, timeout_s=5.0)
        outcome = await it.caller.call(nobody, 0.04)
        assert isinstance(outcome, Unreachable)
        assert outcome.component == "conveyor"

    on_bus(body)


def test_algorithm_1_an_answer_that_cannot_be_decoded_is_a_failure(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        assert is_failed(await it.caller.call(BABBLE, 0.04), "malformed_outcome")

    on_bus(body)


def test_algorithm_2_a_call_for_another_component_is_not_executed(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        assert is_rejected(await deliver(it, request(component="conveyor")), "wrong_component")
        assert not it.gripper.executed

    on_bus(body)


def test_algorithm_2_a_skill_that_the_component_lacks_is_a_failure_that_names_those_it_has(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        outcome = await it.caller.call(NOT_A_SKILL_OF_IT, 0.04)
        assert is_rejected(outcome, "unknown_skill")
        assert isinstance(outcome, Rejected)
        assert "grip" in outcome.detail

    on_bus(body)


def test_algorithm_2_arguments_that_do_not_fit_are_a_failure_that_shows_the_signature(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        assert is_rejected(await it.caller.call(OTHER_ARGUMENTS, "wide"), "schema_mismatch")
        outcome = await deliver(it, request(arguments=OTHER_ARGUMENTS.request("1", "test", "wide").arguments))
        assert is_rejected(outcome, "bad_arguments")
        assert isinstance(outcome, Rejected)
        assert "width_m: float" in outcome.detail
        assert not it.gripper.executed

    on_bus(body)


@pytest.mark.parametrize(
    "bytes_on_the_wire", [b"", b"\xc1", b"\x80", b"\x91" * 100_000], ids=["empty", "invalid", "none", "deep"]
)
def test_algorithm_2_bytes_that_are_not_arguments_are_a_failure(on_bus: Bus, bytes_on_the_wire: bytes) -> None:
    async def body(it: Lab) -> None:
        assert is_rejected(await deliver(it, request(arguments=bytes_on_the_wire)), "bad_arguments")

    on_bus(body)


def test_algorithm_2_a_skill_that_does_not_reach_its_end_is_a_named_failure(on_bus: Bus) -> None:
    async def body(it: Lab) -> None:
        assert is_failed(await it.caller.call(SLIP, 0.04), "slipped")
        assert is_rejected(await it.caller.call(REFUSE, 0.04), "moving")

    on_bus(body)


def test_algorithm_2_an_error_in_a_skill_is_a_failure_and_the_component_lives_on(
    on_bus: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    async def body(it: Lab) -> None:
        outcome = await it.caller.call(BREAK, 0.04)
        assert is_failed(outcome, "error")
        assert isinstance(outcome, Failed)
        assert outcome.detail == "ZeroDivisionError: division by zero"
        assert isinstance(await it.caller.call(GRIP, 0.04), Succeeded)

    on_bus(body)
    assert "gripper.break raised" in caplog.text


def is_failed(outcome: Outcome[float] | Outcome[str], reason: str) -> bool:
    return isinstance(outcome, Failed) and outcome.reason == reason


def is_rejected(outcome: Outcome[float] | Outcome[str], reason: str) -> bool:
    return isinstance(outcome, Rejected) and outcome.reason == reason


def request(**changes: Any) -> SkillCall:
    return msgspec.structs.replace(GRIP.request("1", "test", 0.04), **changes)


async def deliver(it: Lab, call: SkillCall) -> Outcome[float]:
    return codec.decode(await it.deliver(call, lambda progress: None), GRIP.outcome_type)
