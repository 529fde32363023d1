"""Where messages of one topic wait for one reader."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from typing import Generic, TypeVar

from dlokit.communication.topic import Every, Policy

T = TypeVar("T")


class Mailbox(AsyncIterator[T], Generic[T]):
    """Bounded by the topic's policy; when it is full the oldest message goes. One reader."""

    def __init__(self, policy: Policy) -> None:
        self._items: deque[T] = deque(maxlen=policy.depth if isinstance(policy, Every) else 1)
        self._arrived = asyncio.Event()
        self._closed = False
        self.dropped = 0

    def put(self, item: T) -> None:
        """Add a message; on the loop's thread."""
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append(item)
        self._arrived.set()

    def close(self) -> None:
        """No more will come: the reader gets what waits, then the end."""
        self._closed = True
        self._arrived.set()

    def clear(self) -> None:
        """Forget what waits."""
        self._items.clear()

    def __aiter__(self) -> "Mailbox[T]":
        return self

    async def __anext__(self) -> T:
        while not self._items:
            if self._closed:
                raise StopAsyncIteration
            self._arrived.clear()
            await self._arrived.wait()
        return self._items.popleft()
