import asyncio
import signal
import time

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.virtual_time import VirtualDeadlock


async def race(log: list[tuple[float, str]]) -> None:
    """Tasks with simultaneous timers, which wake one another."""
    loop = asyncio.get_running_loop()
    token = asyncio.Semaphore(1)

    async def runner(name: str, period_s: float) -> None:
        for _ in range(20):
            await asyncio.sleep(period_s)
            async with token:
                await asyncio.sleep(0)
                log.append((loop.time(), name))

    await asyncio.gather(runner("a", 0.1), runner("b", 0.1), runner("c", 0.05), runner("d", 0.2))


def test_two_runs_take_the_same_steps_at_the_same_times() -> None:
    first: list[tuple[float, str]] = []
    second: list[tuple[float, str]] = []
    virtual_time.run(race(first))
    virtual_time.run(race(second))
    assert len(first) == 80
    assert first == second


def test_a_long_wait_takes_no_time() -> None:
    async def main() -> float:
        await asyncio.sleep(3600.0)
        return asyncio.get_running_loop().time()

    began = time.monotonic()
    assert virtual_time.run(main()) == pytest.approx(3600.0, abs=1e-6)  # the loop rounds timers to its resolution
    assert time.monotonic() - began < 60.0  # allows for a machine that hangs briefly


def test_every_run_starts_at_zero() -> None:
    async def now() -> float:
        return asyncio.get_running_loop().time()

    assert virtual_time.run(now()) == 0.0
    assert virtual_time.run(now()) == 0.0


def test_tasks_that_wait_for_one_another_are_a_deadlock() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(VirtualDeadlock):
        virtual_time.run(main())


def test_ctrl_c_cancels_the_tasks_with_their_clean_up() -> None:
    cleaned_up: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(5.0, signal.raise_signal, signal.SIGINT)
        try:
            await asyncio.sleep(100.0)
        finally:
            await asyncio.sleep(1.0)
            cleaned_up.append(loop.time())

    with pytest.raises(KeyboardInterrupt):
        virtual_time.run(main())
    # Cancelled at 5 s, and the clean-up took its second.
    assert cleaned_up == [pytest.approx(6.0, abs=1e-6)]


def test_the_result_of_a_run_is_never_formatted() -> None:
    """A result can hold all shapes of a run: its `repr` would take longer than a short run."""

    formatted = list[object]()

    class Result:
        def __repr__(self) -> str:
            formatted.append(self)
            return ""

    result = Result()

    async def main() -> Result:
        return result

    assert virtual_time.run(main()) is result
    assert formatted == []
