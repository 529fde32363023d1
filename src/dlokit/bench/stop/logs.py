"""What the arm does and feels, by the machine's clock: noted on a thread of the network's as it comes."""

import asyncio
import time
from collections import deque
from collections.abc import Callable

from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.types.robot import RobotMode, RobotState

AT_REST = (RobotMode.IDLE, RobotMode.FAULT)


class ArmLog:
    """The arm's modes as it tells them, with the time at which each was first heard of.

    The arm tells its mode 50 times a second of its own clock, so that a time is late by up to 20 ms, and never early.
    """

    def __init__(self, transport: Transport) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._mode: RobotMode | None = None
        self._changes: list[tuple[float, RobotMode]] = []
        transport.tap(topics.ARM_STATE, self._hear)

    @property
    def mode(self) -> RobotMode | None:
        """What the arm does, as was heard last; None: nothing was heard yet."""
        return self._mode

    @property
    def brakings(self) -> int:
        """How often the arm has begun to brake so far."""
        return sum(mode is RobotMode.BRAKING for _, mode in self._changes)

    def mode_at(self, at_s: float) -> RobotMode:
        """What it was first heard to do at one of the times that `until` has given."""
        return next(mode for heard_s, mode in self._changes if heard_s == at_s)

    async def until(self, *modes: RobotMode, after_s: float, within_s: float) -> float | None:
        """When it was first heard to be in one of the modes after `after_s`; None when it is not `within_s` of now."""
        try:
            async with asyncio.timeout(within_s):
                while True:
                    for at_s, mode in self._changes:
                        if at_s > after_s and mode in modes:
                            return at_s
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return None

    def _hear(self, data: bytes) -> None:
        heard_s = time.monotonic()
        mode = codec.decode(data, RobotState).mode
        if mode is self._mode:
            return
        self._mode = mode
        self._changes.append((heard_s, mode))
        self._loop.call_soon_threadsafe(self._changed.set)


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
