import asyncio
import threading
from collections.abc import Callable

from dlokit.skills.viewer.serving.page import LoopGate


def _in_a_thread(function: Callable[..., object], *args: object) -> None:
    thread = threading.Thread(target=function, args=args)
    thread.start()
    thread.join(timeout=5.0)
    assert not thread.is_alive()


def test_what_a_thread_posts_runs_on_the_loops_thread() -> None:
    async def scenario() -> None:
        gate, ran = LoopGate(asyncio.get_running_loop()), asyncio.get_running_loop().create_future()
        _in_a_thread(gate.post, lambda: ran.set_result(threading.get_ident()))
        async with asyncio.timeout(5.0):
            assert await ran == threading.get_ident()

    asyncio.run(scenario())


def test_a_closed_gate_drops_new_and_waiting_calls() -> None:
    async def scenario() -> list[str]:
        gate, ran = LoopGate(asyncio.get_running_loop()), list[str]()
        _in_a_thread(gate.post, ran.append, "waiting")
        gate.shut()
        _in_a_thread(gate.post, ran.append, "late")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        return ran

    assert asyncio.run(scenario()) == []


def test_a_post_to_a_closed_loop_is_dropped_without_an_error() -> None:
    loop = asyncio.new_event_loop()
    gate = LoopGate(loop)
    loop.close()
    gate.post(lambda: None)
