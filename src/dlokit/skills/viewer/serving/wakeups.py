"""Wakes pages on the thread of their server, whichever thread draws.

viser 1.1 wakes waiting connections with `asyncio.Event.set` on the drawing thread. The call raises "deque mutated
during iteration" when a connection begins or ends its wait at that moment, as happens with two or more visitors.
viser then repeats the call on its event loop, so the first call need not wake them.
"""

import asyncio
import importlib
from typing import Any, Literal

from viser.infra._async_message_buffer import AsyncMessageBuffer

_BUFFER = "AsyncMessageBuffer"


class LoopEvent(asyncio.Event):
    """An event that any thread can set, and that wakes its waiting tasks on its event loop only."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._loop_of_waiters = loop
        self._is_set = False

    def is_set(self) -> bool:
        """Whether a thread has set it."""
        return self._is_set

    def set(self) -> None:
        """Let `wait` return immediately; on the event loop, also wake the waiting tasks. Callable on any thread."""
        self._is_set = True
        if asyncio._get_running_loop() is self._loop_of_waiters:
            super().set()

    def clear(self) -> None:
        """Let `wait` block again."""
        self._is_set = False
        super().clear()

    async def wait(self) -> Literal[True]:
        """Wait until it is set."""
        return True if self._is_set else await super().wait()


class LoopBuffer(AsyncMessageBuffer):
    """Messages for connections that are woken on the event loop only."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.message_event = LoopEvent(self.event_loop)


def wake_on_loop() -> None:
    """Make servers that start later use `LoopBuffer`."""
    setattr(importlib.import_module("viser.infra._infra"), _BUFFER, LoopBuffer)
