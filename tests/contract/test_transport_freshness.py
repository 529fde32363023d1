"""Readers get no messages of another schema and no outdated states, and know each message's age."""

import asyncio
import threading
import time

import numpy as np
import pytest
from buses import new_bus
from transport_grid import NEWEST, WAIT_S, Bus, Grid, Reading, connected, eventually, newest_seq, over_zenoh, reading

from dlokit.communication.topic import KeepLast, Topic
from dlokit.communication.wire import codec
from dlokit.communication.wire.schema import fingerprint
from dlokit.communication.zenoh.session import open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message


class OtherReading(Message, frozen=True, kw_only=True, eq=False):
    values: Float64Array
    unit: str


SILENT_S = 0.5
"""Time in which a message that is sent again would arrive, which takes milliseconds."""
OTHER_NEWEST = Topic("test/newest", OtherReading, "source", None, KeepLast())


@pytest.mark.live
def test_messages_of_another_schema_are_dropped_counted_and_logged_at_both_ends(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def body(bus: Bus) -> None:
        here, there = bus.here, bus.there
        assert isinstance(here, ZenohTransport)
        assert isinstance(there, ZenohTransport)
        tapped: list[bytes] = []
        here.tap(NEWEST, tapped.append)
        here.latest(NEWEST)
        await connected(bus)
        there.publish(OTHER_NEWEST, OtherReading(stamp_ns=1, values=np.zeros(2), unit="m"))
        mismatch = (NEWEST.name, "SchemaMismatch")
        # One by the reader's sample, one by the tap's, one by the writer's token; and the reader's token at the writer.
        await eventually(lambda: here.refused.get(mismatch, 0) == 3 and there.refused.get(mismatch, 0) == 1)
        assert here.latest(NEWEST).value is None
        assert not tapped

    over_zenoh(body)
    assert "messages on test/newest dropped: the peer has schema" in caplog.text


@pytest.mark.live
def test_readers_of_the_same_schema_log_nothing() -> None:
    async def body(bus: Bus) -> None:
        assert isinstance(bus.here, ZenohTransport)
        assert isinstance(bus.there, ZenohTransport)
        bus.here.latest(NEWEST)
        bus.there.publish(NEWEST, reading(1))
        await eventually(lambda: newest_seq(bus, NEWEST) == 1)
        assert not bus.here.refused
        assert not bus.there.refused

    over_zenoh(body)


@pytest.mark.live
def test_a_reader_whose_loop_was_busy_reads_the_newest_message() -> None:
    async def body(bus: Bus) -> None:
        stream = bus.here.stream(NEWEST)
        await connected(bus)
        bus.there.publish(NEWEST, reading(1))
        await eventually(lambda: newest_seq(bus, NEWEST) == 1)
        heard = threading.Event()
        assert isinstance(bus.here, ZenohTransport)
        bus.here.tap(NEWEST, lambda data: heard.set())
        await connected(bus)
        bus.there.publish(NEWEST, reading(2))
        assert heard.wait(WAIT_S)  # the loop is blocked, but the message is in this process
        received = bus.here._readers[NEWEST.name]._received  # pyright: ignore[reportPrivateUsage]
        ends_s = time.monotonic() + WAIT_S
        while all(codec.decode(message.data, Reading).seq != 2 for message in list(received)):
            assert time.monotonic() < ends_s
            time.sleep(0.001)  # noqa: ASYNC251  the loop is to stand still
        assert (await anext(stream)).seq == 2
        assert bus.here.latest(NEWEST).value is not None
        assert newest_seq(bus, NEWEST) == 2

    over_zenoh(body)


def test_an_age_counts_from_the_sending_and_not_from_the_reading(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        before_s = asyncio.get_running_loop().time()
        bus.there.publish(NEWEST, reading(1))
        stream = bus.here.stream(NEWEST, with_last=True)
        assert stream.age_s == float("inf")
        await asyncio.sleep(0.05)
        async with asyncio.timeout(WAIT_S):
            await anext(stream)
        elapsed_s = asyncio.get_running_loop().time() - before_s
        for age_s in (stream.age_s, bus.here.latest(NEWEST).age_s):
            assert age_s + 1e-6 >= 0.05  # rounding of two clocks' seconds
            assert age_s < elapsed_s + WAIT_S

    on_bus(body)


@pytest.mark.live
def test_readers_get_once_what_a_restarted_writer_published_before_their_link_to_it_was_open() -> None:
    async def main() -> None:
        bus, names = new_bus(), ("writer", "reader")
        reader, writer = (ZenohTransport(bus.process(name, names)) for name in ("reader", "writer"))
        try:
            async with asyncio.timeout(WAIT_S):
                stream = reader.stream(NEWEST, with_last=True)
                writer.publish(NEWEST, reading(1))
                assert (await anext(stream)).seq == 1
                await writer.close()
                writer = ZenohTransport(bus.process("writer", names))
                writer.publish(NEWEST, reading(2))  # the reader opens the link, 0.02 s later or more
                assert (await anext(stream)).seq == 2
            with open_session(bus.guest) as other:
                token = f"writer/{NEWEST.name}/{fingerprint(NEWEST.type).hex()}/{other.zid()}"
                with other.liveliness().declare_token(token), pytest.raises(TimeoutError):  # as after a reopened link
                    async with asyncio.timeout(SILENT_S):
                        await anext(stream)
        finally:
            await reader.close()
            await writer.close()

    asyncio.run(main())
