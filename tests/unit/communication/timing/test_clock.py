import asyncio

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import Clock, FollowedClock, LoopClock

SECOND_NS = 1_000_000_000


def test_the_loops_clock_shows_the_loops_time() -> None:
    async def main() -> None:
        clock = LoopClock()
        await clock.sleep(1.5)
        assert clock.now_ns() == round(1.5 * SECOND_NS)
        await clock.sleep_until(4 * SECOND_NS)
        assert clock.now_ns() == 4 * SECOND_NS
        await clock.sleep_until(0)
        assert clock.now_ns() == 4 * SECOND_NS

    virtual_time.run(main())


def test_a_followed_clock_shows_its_last_tick_and_never_goes_back() -> None:
    clock = FollowedClock()
    assert clock.now_ns() == 0
    clock.tick(5)
    clock.tick(3)
    assert clock.now_ns() == 5


def test_sleepers_wake_in_the_order_of_their_times() -> None:
    async def main() -> None:
        clock = FollowedClock()
        woken: list[int] = []

        async def sleeper(until_ns: int) -> None:
            await clock.sleep_until(until_ns)
            woken.append(until_ns)

        tasks = [asyncio.create_task(sleeper(until_ns)) for until_ns in (30, 10, 20, 40)]
        await asyncio.sleep(0)
        clock.tick(9)
        await asyncio.sleep(0.1)
        assert woken == []
        clock.tick(30)
        await asyncio.sleep(0.1)
        assert woken == [10, 20, 30]
        clock.tick(40)
        await asyncio.gather(*tasks)
        assert woken == [10, 20, 30, 40]

    virtual_time.run(main())


def test_a_sleep_counts_from_the_last_tick() -> None:
    async def main() -> None:
        clock = FollowedClock()
        clock.tick(2 * SECOND_NS)
        sleeper = asyncio.create_task(clock.sleep(1.0))
        await asyncio.sleep(100.0)
        clock.tick(3 * SECOND_NS - 1)
        await asyncio.sleep(100.0)
        assert not sleeper.done()
        clock.tick(3 * SECOND_NS)
        async with asyncio.timeout(1.0):
            await sleeper

    virtual_time.run(main())


def test_durations_that_begin_before_the_first_tick_count_from_it() -> None:
    days_ns = 5 * 86_400 * 1_000_000_000

    async def main() -> None:
        clock = FollowedClock()
        sleeper = asyncio.create_task(clock.sleep(1.0))
        limited = asyncio.create_task(_limited(clock, 1.0))
        await asyncio.sleep(0)
        clock.tick(days_ns)
        await asyncio.sleep(0.1)
        assert not sleeper.done()
        assert not limited.done()
        clock.tick(days_ns + 1_000_000_000)
        await sleeper
        assert await limited

    virtual_time.run(main())


async def _limited(clock: FollowedClock, seconds: float) -> bool:
    """Whether the limit ends an endless wait."""
    try:
        async with clock.timeout(seconds):
            await asyncio.Event().wait()
    except TimeoutError:
        return True
    return False


def test_a_cancelled_sleeper_is_forgotten_and_the_others_wake() -> None:
    async def main() -> None:
        clock = FollowedClock()
        one, other = (asyncio.create_task(clock.sleep_until(10)) for _ in range(2))
        await asyncio.sleep(0)
        one.cancel()
        await asyncio.sleep(0)
        clock.tick(10)
        async with asyncio.timeout(1.0):
            await other

    virtual_time.run(main())


async def advance(clock: Clock, duration_s: float) -> None:
    if isinstance(clock, FollowedClock):
        clock.tick(clock.now_ns() + round(duration_s * SECOND_NS))
        await asyncio.sleep(0.1)
    else:
        await asyncio.sleep(duration_s)


@pytest.mark.parametrize("kind", [LoopClock, FollowedClock])
def test_a_limit_ends_its_body_on_its_clock(kind: type[LoopClock] | type[FollowedClock]) -> None:
    async def main() -> None:
        clock = kind()
        ended: list[str] = []

        async def limited() -> None:
            try:
                async with clock.timeout(2.0):
                    await asyncio.sleep(1e6)
            except TimeoutError:
                ended.append("timed out")

        if isinstance(clock, FollowedClock):
            clock.tick(1)
        task = asyncio.create_task(limited())
        await asyncio.sleep(0)
        await advance(clock, 1.9)
        assert ended == []
        await advance(clock, 0.2)
        assert ended == ["timed out"]
        await task

    virtual_time.run(main())


@pytest.mark.parametrize("kind", [LoopClock, FollowedClock])
def test_a_body_that_ends_in_time_is_not_disturbed_later(kind: type[LoopClock] | type[FollowedClock]) -> None:
    async def main() -> None:
        clock = kind()
        async with clock.timeout(2.0) as limit:
            await asyncio.sleep(0)
        await advance(clock, 5.0)
        assert not limit.expired()

    virtual_time.run(main())


def test_a_limit_that_expires_as_the_body_ends_has_no_effect() -> None:
    async def main() -> None:
        clock = FollowedClock()
        clock.tick(1)
        failures: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context))
        async with clock.timeout(1.0):
            clock.tick(2 * SECOND_NS)  # the body ends before the loop notifies the limit
        await asyncio.sleep(0.1)
        assert failures == []

    virtual_time.run(main())
