"""A result that is final is not discarded when the run is cancelled while its components end."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.system.live import result_within


class Lamp:
    """Takes a second to go out."""

    def __init__(self) -> None:
        self.fades = asyncio.Event()
        self.is_out = False

    @asynccontextmanager
    async def lit(self) -> AsyncGenerator[str]:
        try:
            yield "lit"
        finally:
            self.fades.set()
            await asyncio.sleep(1.0)
            self.is_out = True


async def read(lamp: str) -> str:
    return f"read while {lamp}"


def test_a_result_is_returned_after_the_end_of_its_context() -> None:
    async def body() -> None:
        lamp = Lamp()
        assert await result_within(lamp.lit(), read) == "read while lit"
        assert lamp.is_out

    virtual_time.run(body())


def test_a_result_is_returned_when_the_end_of_its_context_is_cancelled() -> None:
    async def body() -> None:
        lamp = Lamp()
        run = asyncio.create_task(result_within(lamp.lit(), read))
        await lamp.fades.wait()
        run.cancel()
        assert await run == "read while lit"
        assert not lamp.is_out

    virtual_time.run(body())


def test_work_that_is_cancelled_has_no_result() -> None:
    async def body() -> None:
        lamp, reading = Lamp(), asyncio.Event()

        async def read_for_ever(_: str) -> str:
            reading.set()
            return str(await asyncio.Event().wait())

        run = asyncio.create_task(result_within(lamp.lit(), read_for_ever))
        await reading.wait()
        run.cancel()
        with pytest.raises(asyncio.CancelledError):
            await run
        assert lamp.is_out

    virtual_time.run(body())
