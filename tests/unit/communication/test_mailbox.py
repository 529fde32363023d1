import asyncio

import pytest

from dlokit.communication import virtual_time
from dlokit.communication.mailbox import Mailbox
from dlokit.communication.topic import Every, KeepLast


async def drained(mailbox: Mailbox[int]) -> list[int]:
    mailbox.close()
    return [item async for item in mailbox]


@pytest.mark.parametrize(("depth", "kept"), [(1, [4]), (3, [2, 3, 4]), (9, [0, 1, 2, 3, 4])])
def test_the_newest_messages_stay_in_order_up_to_the_depth(depth: int, kept: list[int]) -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(Every(depth))
        for item in range(5):
            mailbox.put(item)
        assert mailbox.dropped == 5 - len(kept)
        assert await drained(mailbox) == kept

    virtual_time.run(main())


def test_keep_last_keeps_one() -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(KeepLast())
        mailbox.put(1)
        mailbox.put(2)
        assert await drained(mailbox) == [2]

    virtual_time.run(main())


def test_a_reader_that_waits_is_woken_by_a_message() -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(Every(2))
        reader = asyncio.create_task(anext(mailbox))
        await asyncio.sleep(1.0)
        assert not reader.done()
        mailbox.put(7)
        async with asyncio.timeout(1.0):
            assert await reader == 7

    virtual_time.run(main())


def test_a_reader_that_waits_when_the_box_closes_comes_to_an_end() -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(Every(2))
        reader = asyncio.create_task(drain(mailbox))
        await asyncio.sleep(1.0)
        mailbox.close()
        async with asyncio.timeout(1.0):
            assert await reader == []

    async def drain(mailbox: Mailbox[int]) -> list[int]:
        return [item async for item in mailbox]

    virtual_time.run(main())


def test_a_cleared_box_has_forgotten_what_waited() -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(Every(2))
        mailbox.put(1)
        mailbox.clear()
        mailbox.put(2)
        assert await drained(mailbox) == [2]

    virtual_time.run(main())
