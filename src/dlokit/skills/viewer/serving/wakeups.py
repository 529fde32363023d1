"""Pages are woken on the thread of their server, whichever thread draws.

viser 1.1 wakes the connections that wait for messages with `asyncio.Event.set`, on the thread that draws: it raises
"deque mutated during iteration" there when a connection begins or ends to wait at that moment, which happens with two
visitors and more. Right afterwards viser has its event loop do the same, so that the first call need not wake them.
"""

import asyncio
import importlib
from typing import Any, Literal

from viser.infra._async_message_buffer import AsyncMessageBuffer

_BUFFER = "AsyncMessageBuffer"


class LoopEvent(asyncio.Event):
    """An event that wakes those who wait on its event loop alone; set by any thread, `wait` returns at once."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop_of_waiters = loop
        self._is_set = False

    def is_set(self) -> bool:
        """Whether a thread has set it."""
        return self._is_set

    def set(self) -> None:
        """Let `wait` return at once, and on the event loop wake those who wait. Callable on any thread."""
        self._is_set = True
        if asyncio._get_running_loop() is self._loop_of_waiters:
            super().set()

    def clear(self) -> None:
        """Let `wait` wait again."""
        self._is_set = False
        super().clear()

    async def wait(self) -> Literal[True]:
        """Wait until it is set."""
        return True if self._is_set else await super().wait()


class LoopBuffer(AsyncMessageBuffer):
    """Messages for connections, which are woken on the event loop alone."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.message_event = LoopEvent(self.event_loop)


def wake_on_loop() -> None:
    """Have servers that start from now on use `LoopBuffer`."""
    setattr(importlib.import_module("viser.infra._infra"), _BUFFER, LoopBuffer)
