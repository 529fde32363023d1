"""The container: which parts it connects, in which order, and how it handles a component's errors."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import FollowedClock, LoopClock
from dlokit.errors import CommunicationError, ConfigError, SkillFailure
from dlokit.types.flow import FlowStatus
from dlokit.types.outcome import Cancelled, Failed, Succeeded, TimedOut
from dlokit.types.system import ClockTick


def _nothing() -> None:
    """Nothing."""
    ...


GIVE_UP = Skill("model", "give_up", _nothing, timeout_s=1.0)
SLEEP = Skill("model", "sleep", _nothing, timeout_s=2.0)
TIME_OUT_INSIDE = Skill("model", "time_out_inside", _nothing, timeout_s=1.0)


def status(number: int) -> FlowStatus:
    return FlowStatus(stamp_ns=number, flow="f", step=str(number))


class Listener(Component):
    name = "model"

    def __init__(self) -> None:
        self.heard: list[int] = []
        self.ran_to_its_end = False

    @on(topics.FLOW)
    async def on_flow(self, message: FlowStatus) -> None:
        if message.stamp_ns == 13:
            raise SkillFailure("unlucky")
        await self.port.clock.sleep(1.0)
        self.heard.append(message.stamp_ns)

    @on(topics.CLOCK)
    async def on_clock(self, message: ClockTick) -> None:
        self.heard.append(-message.stamp_ns)

    @implements(GIVE_UP)
    async def give_up(self) -> None:
        raise asyncio.CancelledError

    @implements(SLEEP)
    async def sleep(self) -> None:
        await self.port.clock.sleep(1e6)

    @implements(TIME_OUT_INSIDE)
    async def time_out_inside(self) -> None:
        raise TimeoutError("the camera is slow")

    async def run(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            self.ran_to_its_end = True


class Speaker(Component):
    name = "decision"
    publishes = (topics.FLOW,)

    async def run(self) -> None:
        self.port.publish(topics.FLOW, status(1))
        self.port.publish(topics.FLOW, status(2))


def in_lockstep(main: Coroutine[Any, Any, None]) -> None:
    virtual_time.run(main)


def test_the_first_message_reaches_other_components_in_any_order_of_addition() -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        listener = Listener()
        host.add(Speaker())
        host.add(listener)
        async with host:
            await asyncio.sleep(5.0)
        assert listener.heard == [1, 2]

    in_lockstep(main())


def test_handlers_take_one_message_at_a_time_in_order() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        listener = Listener()
        host.add(listener)
        async with host:
            for number in range(1, 4):
                bus.publish(topics.FLOW, status(number))
            await asyncio.sleep(2.5)
            assert listener.heard == [1, 2]
            await asyncio.sleep(1.0)
            assert listener.heard == [1, 2, 3]

    in_lockstep(main())


def test_a_late_handler_gets_the_last_state_but_no_earlier_event() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        bus.publish(topics.CLOCK, ClockTick(stamp_ns=7))
        bus.publish(topics.FLOW, status(1))
        host = Container(bus, LoopClock())
        listener = Listener()
        host.add(listener)
        async with host:
            await asyncio.sleep(5.0)
        assert listener.heard == [-7]

    in_lockstep(main())


def test_a_message_that_a_handler_cannot_use_does_not_end_it(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        listener = Listener()
        host.add(listener)
        async with host:
            bus.publish(topics.FLOW, status(13))
            bus.publish(topics.FLOW, status(14))
            await asyncio.sleep(5.0)
        assert listener.heard == [14]

    in_lockstep(main())
    assert "unlucky" in caplog.text


def test_an_error_of_a_components_task_is_raised_to_the_waiting_caller(caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Component):
        name = "viewer"

        async def run(self) -> None:
            raise ZeroDivisionError("broken")

    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        host.add(Broken())
        async with host:
            with pytest.raises(ZeroDivisionError, match="broken"):
                await host.wait_failed()

    in_lockstep(main())
    assert "viewer run ended" in caplog.text


class Late(Component):
    """Fails after a second."""

    name = "viewer"

    async def run(self) -> None:
        await asyncio.sleep(1.0)
        raise ZeroDivisionError("broken")


def test_a_guarded_block_is_cancelled_by_a_failing_component_whose_error_counts_more_than_its_result() -> None:
    ended: list[str] = []

    async def block() -> str:
        try:
            await asyncio.sleep(60.0)
        except asyncio.CancelledError:
            ended.append("made safe")
        return "a result that does not count"

    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        host.add(Late())
        async with host:
            with pytest.raises(ZeroDivisionError, match="broken"):
                async with host.guarded():
                    await block()
            await asyncio.sleep(1.0)  # the cancellation is over

    in_lockstep(main())
    assert ended == ["made safe"]


def test_a_guarded_block_that_ends_first_is_not_disturbed_afterwards() -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        host.add(Late())
        async with host:
            async with host.guarded():
                await asyncio.sleep(0.5)
            await asyncio.sleep(1.0)

    in_lockstep(main())


def test_a_cancellation_from_elsewhere_reaches_a_guarded_block_which_may_return_a_result() -> None:
    async def main() -> str:
        host = Container(MemoryTransport(), LoopClock())
        async with host, host.guarded():
            try:
                await asyncio.sleep(60.0)
            except asyncio.CancelledError:
                return "cancelled, with a result"
        return ""

    async def caller() -> None:
        task = asyncio.create_task(main())
        await asyncio.sleep(1.0)
        task.cancel()
        assert await task == "cancelled, with a result"

    in_lockstep(caller())


def test_the_end_of_the_container_cancels_running_calls_and_accepts_no_more() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        listener = Listener()
        host.add(listener)
        async with host:
            await asyncio.sleep(0)
            assert bus.alive("model").alive
        assert listener.ran_to_its_end
        assert not bus.alive("model").alive

    in_lockstep(main())


def test_a_component_may_declare_only_topics_whose_row_names_it() -> None:
    class Impostor(Component):
        name = "viewer"
        publishes = (topics.STATE,)

    with pytest.raises(ConfigError, match="viewer cannot publish model/state"):
        Container(MemoryTransport(), LoopClock()).add(Impostor())


def test_a_component_reads_and_publishes_only_what_it_declares() -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        speaker = Speaker()
        host.add(speaker)
        with pytest.raises(CommunicationError, match="decision may not publish model/state"):
            speaker.port.publish(topics.STATE, status(1))  # pyright: ignore[reportArgumentType] - refused before that
        with pytest.raises(CommunicationError, match="decision may not read model/state"):
            speaker.port.latest(topics.STATE)
        with pytest.raises(CommunicationError, match="decision may not read model/state"):
            speaker.port.stream(topics.STATE)

    in_lockstep(main())


def test_published_messages_are_numbered_on_their_topic() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        stream = aiter(bus.stream(topics.FLOW))
        host = Container(bus, LoopClock())
        host.add(Speaker())
        async with host:
            assert [(await anext(stream)).seq for _ in range(2)] == [1, 2]

    in_lockstep(main())


def test_a_skill_that_cancels_itself_is_cancelled_and_its_caller_is_not() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        host.add(Listener())
        async with host:
            assert isinstance(await bus.call(GIVE_UP), Cancelled)

    in_lockstep(main())


def test_a_time_out_inside_a_skill_is_a_failure_and_not_the_skills_own_limit() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        host.add(Listener())
        async with host:
            outcome = await bus.call(TIME_OUT_INSIDE)
            assert isinstance(outcome, Failed)
            assert outcome.reason == "timeout_inside"

    in_lockstep(main())


def test_the_time_limit_of_a_skill_counts_on_its_components_clock() -> None:
    async def main() -> None:
        bus = MemoryTransport()
        clock = FollowedClock()
        clock.tick(1)
        host = Container(bus, clock)
        host.add(Listener())
        async with host:
            call = asyncio.create_task(bus.call(SLEEP))
            await asyncio.sleep(1000.0)  # machine time: a cell whose clock does not advance must not end the skill
            assert not call.done()
            clock.tick(3_000_000_000)
            assert isinstance(await call, TimedOut)

    in_lockstep(main())


def test_every_kind_of_result_crosses_the_bus() -> None:
    def _size(text: str, factor: int = 2) -> tuple[int, str | None]:
        """Length of a text, and the text itself unless it is empty."""
        ...

    measure = Skill("model", "size", _size, timeout_s=1.0)

    class Sizes(Component):
        name = "model"

        @implements(measure)
        async def size(self, text: str, factor: int = 2) -> tuple[int, str | None]:
            return factor * len(text), text or None

    async def main() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        host.add(Sizes())
        async with host:
            outcome = await bus.call(measure, "abc", factor=3)
            assert isinstance(outcome, Succeeded)
            assert outcome.result == (9, "abc")
            empty = await bus.call(measure, "")
            assert isinstance(empty, Succeeded)
            assert empty.result == (0, None)

    in_lockstep(main())


def test_a_preparation_runs_where_the_component_computes_and_its_failure_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    loaded: list[str] = []

    def broken() -> None:
        raise ImportError("no such library")

    class Broken(Speaker):
        def preparation(self) -> Callable[[], object]:
            return broken

    class Careful(Component):
        name = "planning"

        def preparation(self) -> Callable[[], object]:
            return lambda: loaded.append("loaded")

    async def compute(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        loaded.append("asked for")
        return function(*args, **kwargs)

    async def scenario() -> None:
        host = Container(MemoryTransport(), LoopClock(), compute)
        host.add(Listener())
        host.add(Broken())
        host.add(Careful())
        await host.prepare()

    in_lockstep(scenario())
    assert loaded == ["asked for", "asked for", "loaded"]
    assert "no such library" in caplog.text
