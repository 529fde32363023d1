"""Drawing on one thread, while the connections of many visitors wait on another."""

import asyncio
import itertools
import threading
from collections import Counter

import pytest
import viser
from websockets.asyncio.client import connect
from websockets.typing import Origin, Subprotocol

from dlokit.skills.viewer.serving.page import close_page, open_page
from dlokit.skills.viewer.serving.wakeups import LoopEvent

VISITORS = 3
LIMIT_S = 20.0


async def _visit(port: int, drawing: asyncio.Barrier, drawn: asyncio.Event, received: Counter[int], who: int) -> None:
    """Open the page, let the drawing begin, and count what is `received`, until it is `drawn`."""
    async with connect(
        f"ws://127.0.0.1:{port}/key/",
        origin=Origin(f"http://127.0.0.1:{port}"),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        proxy=None,
    ) as client:
        await client.recv()
        await drawing.wait()
        while not drawn.is_set():
            await client.recv()
            received[who] += 1


def test_pages_are_woken_on_the_servers_thread_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waking them where the scene is drawn raised there: with eight visitors 9 times in 500 drawings."""
    woken_on: set[str] = set()
    wake = asyncio.Event.set
    server = open_page("127.0.0.1", 0, "key")
    messages = vars(vars(server)["_websock_server"])["_broadcast_buffer"].message_event

    def recorded(event: asyncio.Event) -> None:
        if event is messages:
            woken_on.add(threading.current_thread().name)
        wake(event)

    async def scenario() -> None:
        drawing, drawn, received = asyncio.Barrier(VISITORS + 1), asyncio.Event(), Counter[int]()
        port = server.get_port()
        visits = [asyncio.create_task(_visit(port, drawing, drawn, received, who)) for who in range(VISITORS)]
        await drawing.wait()
        frame = server.scene.add_frame("/drawn")
        for place in itertools.count():
            with server.atomic():
                frame.position = (place, 0.0, 0.0)
            await asyncio.sleep(0.02)
            if place > 20 and all(received[who] > 1 for who in range(VISITORS)):
                break
        drawn.set()
        frame.position = (0.0, 0.0, 1.0)
        await asyncio.gather(*visits)

    monkeypatch.setattr(asyncio.Event, "set", recorded)
    try:
        asyncio.run(asyncio.wait_for(scenario(), LIMIT_S))
    finally:
        close_page(server)
    assert len(woken_on) == 1
    assert threading.current_thread().name not in woken_on


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
