import asyncio
import threading

import pytest

from dlokit.communication.zenoh.connection import LoopDoor


def test_what_other_threads_ask_for_runs_on_the_loops_thread_and_in_their_order() -> None:
    async def main() -> None:
        door = LoopDoor()
        heard: list[tuple[int, int]] = []
        done = asyncio.Event()

        def ask(thread: int) -> None:
            for number in range(500):
                door.call(note, thread, number)

        def note(thread: int, number: int) -> None:
            assert threading.current_thread() is threading.main_thread()
            heard.append((thread, number))
            if len(heard) == 2000:
                done.set()

        threads = [threading.Thread(target=ask, args=(thread,)) for thread in range(4)]
        for thread in threads:
            thread.start()
        async with asyncio.timeout(10.0):  # a lost knock is a loop that is never woken
            await done.wait()
        for thread in range(4):
            assert [number for who, number in heard if who == thread] == list(range(500))
        door.close()

    asyncio.run(main())


def test_a_function_that_raises_does_not_hold_up_the_next(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        door = LoopDoor()
        done = asyncio.Event()
        door.call(lambda: 1 / 0)
        door.call(done.set)
        async with asyncio.timeout(10.0):
            await done.wait()
        door.close()

    asyncio.run(main())
    assert "ZeroDivisionError" in caplog.text


def test_functions_that_ask_for_more_leave_the_loop_its_turns() -> None:
    async def main() -> None:
        door = LoopDoor()
        begun = asyncio.Event()
        runs = 0

        def again() -> None:
            nonlocal runs
            runs += 1
            begun.set()
            if runs < 1000:
                door.call(again)

        door.call(again)
        async with asyncio.timeout(10.0):
            await begun.wait()
        assert runs < 1000, "the others had no turn until all was done"
        door.close()

    asyncio.run(main())


def test_a_closed_door_opens_for_nobody_and_complains_to_nobody() -> None:
    async def main() -> None:
        door = LoopDoor()
        door.close()
        door.call(pytest.fail, "the door is closed")
        await asyncio.sleep(0)

    asyncio.run(main())
