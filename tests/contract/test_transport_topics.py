"""Requirements on every transport: publish, read, stream and close."""

import asyncio

import numpy as np
import pytest
from transport_grid import (
    EACH,
    NEWEST,
    WAIT_S,
    Bus,
    Grid,
    Reading,
    connected,
    eventually,
    newest_seq,
    reading,
    zenoh_bus,
)

from dlokit.communication.topic import Topic


def test_a_topic_has_no_value_before_its_first_message(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        latest = bus.here.latest(NEWEST)
        assert latest.value is None
        assert latest.age_s == float("inf")

    on_bus(body)


def test_a_published_message_arrives_whole_and_read_only(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        bus.here.latest(NEWEST)
        await connected(bus)
        bus.there.publish(NEWEST, reading(7))
        await eventually(lambda: bus.here.latest(NEWEST).value is not None)
        value = bus.here.latest(NEWEST).value
        assert value is not None
        assert (value.stamp_ns, value.seq) == (7, 7)
        np.testing.assert_array_equal(value.values, [1.0, 7.0])
        assert not value.values.flags.writeable
        assert 0.0 <= bus.here.latest(NEWEST).age_s < WAIT_S

    on_bus(body)


def test_a_publisher_reads_its_own_messages(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        bus.here.publish(EACH, reading(1))
        async with asyncio.timeout(WAIT_S):
            assert (await anext(stream)).seq == 1

    on_bus(body)


def test_a_stream_keeps_the_order(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        await connected(bus)
        async with asyncio.timeout(WAIT_S):
            for number in range(1, 51):
                bus.there.publish(EACH, reading(number))
                assert (await anext(stream)).seq == number

    on_bus(body)


def test_a_slow_reader_of_every_message_loses_the_oldest_ones_above_the_depth(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        await connected(bus)
        for number in range(1, 11):
            bus.there.publish(EACH, reading(number))
        await eventually(lambda: newest_seq(bus, EACH) == 10)
        async with asyncio.timeout(WAIT_S):
            assert [(await anext(stream)).seq for _ in range(4)] == [7, 8, 9, 10]

    on_bus(body)


def test_a_slow_reader_of_a_state_sees_only_the_newest(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(NEWEST))
        await connected(bus)
        for number in range(1, 11):
            bus.there.publish(NEWEST, reading(number))
        await eventually(lambda: newest_seq(bus, NEWEST) == 10)
        async with asyncio.timeout(WAIT_S):
            assert (await anext(stream)).seq == 10

    on_bus(body)


@pytest.mark.parametrize("topic", [NEWEST, EACH], ids=["keep last", "every"])
def test_a_late_reader_gets_the_last_message(on_bus: Grid, topic: Topic[Reading]) -> None:
    async def body(bus: Bus) -> None:
        bus.there.publish(topic, reading(1))
        bus.there.publish(topic, reading(2))
        await eventually(lambda: newest_seq(bus, topic) == 2)

    on_bus(body)


def test_a_late_stream_begins_with_the_last_message_only_on_request(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        await connected(bus)
        bus.there.publish(NEWEST, reading(1))
        informed = aiter(bus.here.stream(NEWEST, with_last=True))
        plain = aiter(bus.here.stream(NEWEST))
        async with asyncio.timeout(WAIT_S):
            assert (await anext(informed)).seq == 1
            bus.there.publish(NEWEST, reading(2))
            assert (await anext(plain)).seq == 2
            assert (await anext(informed)).seq == 2

    on_bus(body)


def test_streams_end_when_the_transport_closes(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        await bus.here.close()
        with pytest.raises(StopAsyncIteration):
            await anext(stream)

    on_bus(body)


@pytest.mark.live
def test_concurrent_runs_receive_no_messages_of_each_other() -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S * 2), zenoh_bus() as mine, zenoh_bus() as theirs:
            for bus in (mine, theirs):
                bus.here.latest(NEWEST)
                await connected(bus)
            mine.there.publish(NEWEST, reading(1))
            theirs.there.publish(NEWEST, reading(2))
            await eventually(lambda: newest_seq(mine, NEWEST) > 0 and newest_seq(theirs, NEWEST) > 0)
            assert (newest_seq(mine, NEWEST), newest_seq(theirs, NEWEST)) == (1, 2)

    asyncio.run(main())
