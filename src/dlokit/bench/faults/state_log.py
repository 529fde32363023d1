"""The arm's feedback, by the machine's clock: noted on a thread of the network's as it comes."""

import asyncio
import time
from collections import deque
from collections.abc import Callable

from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.types.robot import RobotState

KEPT = 6000
"""States that are kept: two minutes."""


class StateLog:
    """The states that the arm's sensors publish, with the time at which each was received.

    The cell publishes 50 a second of its own clock. Made and used on a running event loop.
    """

    def __init__(self, transport: Transport) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._states = deque[tuple[float, RobotState]](maxlen=KEPT)
        transport.tap(topics.ARM_STATE, self._receive)

    @property
    def newest(self) -> RobotState | None:
        """The state received last; None before the first."""
        return self._states[-1][1] if self._states else None

    def since(self, at_s: float) -> list[RobotState]:
        """The last state received before `at_s` [s of the machine's monotonic clock], and all after it."""
        states = list(self._states)
        before = sum(received_s < at_s for received_s, _ in states)
        return [state for _, state in states[max(before - 1, 0) :]]

    async def until(self, is_so: Callable[[RobotState], bool], within_s: float) -> bool:
        """Wait for a new state for which `is_so` holds; whether one came within `within_s` [s]."""
        seen_s = time.monotonic()
        try:
            async with asyncio.timeout(within_s):
                while not (self._states and self._states[-1][0] > seen_s and is_so(self._states[-1][1])):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def _receive(self, data: bytes) -> None:
        self._states.append((time.monotonic(), codec.decode(data, RobotState)))
        self._loop.call_soon_threadsafe(self._changed.set)
