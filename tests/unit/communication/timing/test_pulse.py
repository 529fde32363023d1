"""Heartbeats: they continue while the loop is busy briefly, and stop when it hangs."""

import asyncio
import threading

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.pulse import ThreadPulse, loop_pulse

PATIENCE_S = 60.0  # it takes milliseconds; only a failing test waits this long
PERIOD_S = 0.005


def test_the_loop_sends_heartbeats_at_the_period() -> None:
    async def main() -> None:
        given: list[float] = []
        async with loop_pulse(lambda: given.append(round(asyncio.get_running_loop().time(), 3)), 0.04):
            await asyncio.sleep(0.13)
        await asyncio.sleep(1.0)
        assert given == [0.04, 0.08, 0.12]

    virtual_time.run(main())


def test_a_busy_loop_delays_no_heartbeat() -> None:
    async def main() -> None:
        given = threading.Semaphore(0)
        async with ThreadPulse(PATIENCE_S)(lambda: given.release(), PERIOD_S):
            # The loop completes no turn in between.
            assert all(given.acquire(timeout=PATIENCE_S) for _ in range(3))

    asyncio.run(main())


def test_heartbeats_stop_while_the_loop_hangs_and_resume() -> None:
    hung_s, silent_s = 0.0, 1.0
    heard, looked = threading.Event(), threading.Semaphore(0)

    def now_s() -> float:
        told_s = hung_s
        if threading.current_thread().name == "pulse":
            looked.release()
        return told_s

    def looks_twice() -> bool:
        """Wait until what the thread does after a look that it has begun is over."""
        while looked.acquire(blocking=False):
            pass
        return all(looked.acquire(timeout=PATIENCE_S) for _ in range(2))

    async def main() -> None:
        nonlocal hung_s
        async with ThreadPulse(silent_s, now_s)(heard.set, PERIOD_S):
            assert heard.wait(PATIENCE_S)
            hung_s = 1.1 * silent_s  # the loop hangs here
            assert looks_twice()
            heard.clear()
            assert looks_twice()
            assert not heard.is_set()
            await asyncio.sleep(silent_s)  # the loop goes on
            assert heard.wait(PATIENCE_S)

    virtual_time.run(main())


def test_a_failed_heartbeat_does_not_end_the_others() -> None:
    async def main() -> None:
        tried = threading.Semaphore(0)

        def give() -> None:
            tried.release()
            raise RuntimeError("the network is not there")

        async with ThreadPulse(PATIENCE_S)(give, PERIOD_S):
            assert all(tried.acquire(timeout=PATIENCE_S) for _ in range(2))

    asyncio.run(main())
