import asyncio

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.communication.topic import Every, KeepLast
from dlokit.communication.transport import Mailbox


async def drained(mailbox: Mailbox[int]) -> list[int]:
    mailbox.close()
    return [item async for item in mailbox]


@pytest.mark.parametrize(("depth", "kept"), [(1, [4]), (3, [2, 3, 4]), (9, [0, 1, 2, 3, 4])])
def test_the_newest_messages_stay_in_order_up_to_the_depth(depth: int, kept: list[int]) -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(Every(depth))
        for item in range(5):
            mailbox.put(item, 0.0)
        assert mailbox.dropped == 5 - len(kept)
        assert await drained(mailbox) == kept

    virtual_time.run(main())


def test_keep_last_keeps_one() -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(KeepLast())
        mailbox.put(1, 0.0)
        mailbox.put(2, 0.0)
        assert await drained(mailbox) == [2]

    virtual_time.run(main())


def test_a_reader_that_waits_is_woken_by_a_message() -> None:
    async def main() -> None:
        mailbox: Mailbox[int] = Mailbox(Every(2))
        reader = asyncio.create_task(anext(mailbox))
        await asyncio.sleep(1.0)
        assert not reader.done()
        mailbox.put(7, 0.0)
        async with asyncio.timeout(1.0):
            assert await reader == 7

    virtual_time.run(main())


def test_a_reader_that_waits_ends_when_the_mailbox_closes() -> None:
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


def test_a_reader_learns_the_age_of_what_it_has_read() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        mailbox: Mailbox[int] = Mailbox(Every(2))
        assert mailbox.age_s == float("inf")
        mailbox.put(1, loop.time() - 0.25)
        await asyncio.sleep(0.5)
        assert await anext(mailbox) == 1
        assert mailbox.age_s == pytest.approx(0.75, abs=1e-9)  # rounding of the virtual clock

    virtual_time.run(main())


def test_a_returning_reader_gets_the_newest_message_and_not_the_waiting_one() -> None:
    async def main() -> None:
        arrived = [2]
        mailbox: Mailbox[int] = Mailbox(KeepLast(), lambda: mailbox.put(arrived.pop(), 0.0))
        mailbox.put(1, 0.0)
        assert await anext(mailbox) == 2

    virtual_time.run(main())
