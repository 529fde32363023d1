"""Heartbeats: they continue while the loop is busy briefly, and stop when it hangs."""

import asyncio
import threading
import time

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.pulse import ThreadPulse, loop_pulse

PATIENCE_S = 30.0  # it takes milliseconds; only a failing test waits this long
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
    async def main() -> None:
        heard = threading.Event()
        silent_s = 0.03
        async with ThreadPulse(silent_s)(heard.set, PERIOD_S):
            end_s = time.monotonic() + PATIENCE_S
            while heard.wait(10 * silent_s):  # the loop hangs here until no heartbeat has come for a long time
                heard.clear()
                assert time.monotonic() < end_s
            assert await asyncio.to_thread(heard.wait, PATIENCE_S)

    asyncio.run(main())


def test_a_failed_heartbeat_does_not_end_the_others() -> None:
    async def main() -> None:
        tried = threading.Semaphore(0)

        def give() -> None:
            tried.release()
            raise RuntimeError("the network is not there")

        async with ThreadPulse(PATIENCE_S)(give, PERIOD_S):
            assert all(tried.acquire(timeout=PATIENCE_S) for _ in range(2))

    asyncio.run(main())
