"""Several instances of a component: calls and messages reach the addressed one."""

import asyncio

import pytest

from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.recording.channels import type_of
from dlokit.types.flow import FlowStatus
from dlokit.types.outcome import Succeeded, Unreachable


def _who() -> str:
    """Name of the instance that answers."""
    ...


WHO = Skill("decision", "who", _who, timeout_s=1.0)


class Speaker(Component):
    name = "decision"
    publishes = (topics.FLOW,)

    def __init__(self, instance: str) -> None:
        self.instance = instance

    async def run(self) -> None:
        self.port.publish(topics.FLOW, FlowStatus(stamp_ns=1, flow="f", step=self.address))

    @implements(WHO)
    async def who(self) -> str:
        return self.address


class Listener(Component):
    name = "viewer"
    reads = (topics.FLOW,)

    def __init__(self) -> None:
        self.heard: list[str] = []

    @on(topics.FLOW)
    async def on_flow(self, message: FlowStatus) -> None:
        self.heard.append(message.step)


async def _three() -> tuple[Container, Listener]:
    host = Container(MemoryTransport(), LoopClock(), instances={"decision": ("left", "right")})
    listener = Listener()
    for component in (listener, Speaker(""), Speaker("left"), Speaker("right")):
        host.add(component)
    return host, listener


def test_a_call_reaches_the_addressed_instance() -> None:
    async def main() -> None:
        host, _ = await _three()
        async with host:
            for instance, address in (("", "decision"), ("left", "decision.left"), ("right", "decision.right")):
                answer = await host.transport.call(WHO.at(instance))
                assert isinstance(answer, Succeeded)
                assert answer.result == address
            assert isinstance(await host.transport.call(WHO.at("middle")), Unreachable)

    virtual_time.run(main())


def test_a_reader_receives_every_instance_and_each_has_its_own_topic() -> None:
    async def main() -> None:
        host, listener = await _three()
        async with host:
            await asyncio.sleep(1.0)
            assert sorted(listener.heard) == ["decision", "decision.left", "decision.right"]
            for instance in ("", "left", "right"):
                newest = listener.port.latest(topics.FLOW.at(instance)).value
                assert newest is not None
                assert newest.step.partition(".")[2] == instance
                assert newest.seq == 1

    virtual_time.run(main())


@pytest.mark.parametrize("named", [WHO, WHO.at("left")])
def test_an_address_replaces_the_previous_one(named: Skill[[], str]) -> None:
    assert named.at("right").key == "decision.right.who"
    assert named.at("") == WHO


def test_a_topic_of_an_instance_belongs_to_the_same_row() -> None:
    right = topics.FLOW.at("left").at("right")
    assert (right.name, right.row, right.publisher) == ("decision/flow/right", "decision/flow", "decision")
    assert right.at("") == topics.FLOW
    assert type_of(right.name) is FlowStatus
    assert type_of("view/left") is None
