"""What wakes the connections of a page; many visitors of one are in tests/live."""

import asyncio

from dlokit.skills.viewer.serving.wakeups import LoopEvent

LIMIT_S = 20.0


def test_an_event_set_by_another_thread_wakes_nobody_and_lets_nobody_wait() -> None:
    async def scenario() -> None:
        event = LoopEvent(asyncio.get_running_loop())
        waiting = asyncio.create_task(event.wait())
        await asyncio.sleep(0)
        await asyncio.to_thread(event.set)
        await asyncio.sleep(0)
        assert not waiting.done()
        await asyncio.wait_for(event.wait(), LIMIT_S)
        event.set()
        await asyncio.wait_for(waiting, LIMIT_S)
        event.clear()
        assert not event.is_set()

    asyncio.run(scenario())
