"""What the arm does and what the flow of a task does, with the time at which each message was received.

Times are of the machine's monotonic clock [s].
"""

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable

from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.types.flow import FlowStatus
from dlokit.types.robot import RobotMode, RobotState

AT_REST = (RobotMode.IDLE, RobotMode.FAULT)
KEPT = 6000
"""States of an arm that are kept: two minutes."""


class Changing:
    """Something that is looked at after each of its changes. Made and used on a running event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()

    def note_change(self) -> None:
        """Wake those that wait; callable from any thread."""
        self._loop.call_soon_threadsafe(self._changed.set)

    async def until(self, is_so: Callable[[], bool], within_s: float = math.inf) -> bool:
        """Wait until `is_so` holds; whether it did within `within_s` [s]."""
        try:
            async with asyncio.timeout(within_s):
                while not is_so():
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True


class ArmLog(Changing):
    """The states that the arm's sensors publish, and the changes of its mode.

    The cell publishes 50 states a second of its own clock: a time is late by up to 20 ms, and never early.
    """

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        self._states = deque[tuple[float, RobotState]](maxlen=KEPT)
        self._modes: list[tuple[float, RobotMode]] = []
        transport.tap(topics.ARM_STATE, self._receive)

    @property
    def newest(self) -> RobotState | None:
        """The state received last; None before the first."""
        return self._states[-1][1] if self._states else None

    @property
    def mode(self) -> RobotMode | None:
        """The mode received last; None before the first."""
        return self._modes[-1][1] if self._modes else None

    @property
    def brakings(self) -> int:
        """Number of times that the arm has begun to brake."""
        return sum(mode is RobotMode.BRAKING for _, mode in self._modes)

    def mode_at(self, at_s: float) -> RobotMode:
        """The mode that began at one of the times that `until_mode` has returned."""
        return next(mode for began_s, mode in self._modes if began_s == at_s)

    def since(self, at_s: float) -> list[RobotState]:
        """The last state received before `at_s`, and all after it."""
        states = list(self._states)
        before = sum(received_s < at_s for received_s, _ in states)
        return [state for _, state in states[max(before - 1, 0) :]]

    async def until_mode(self, *modes: RobotMode, after_s: float, within_s: float) -> float | None:
        """Wait until one of the modes has begun after `after_s`; when it began, or None if not `within_s` of now."""
        found: list[float] = []

        def begun() -> bool:
            found.extend(at_s for at_s, mode in self._modes if at_s > after_s and mode in modes)
            return bool(found)

        return found[0] if await self.until(begun, within_s) else None

    async def braked(self, struck_s: float, within_s: float) -> tuple[bool, float | None]:
        """Whether a fault at `struck_s` interrupted a motion, and when the arm began to brake.

        A motion that came to its end before anybody had to notice was not interrupted.
        """
        at_s = await self.until_mode(RobotMode.BRAKING, *AT_REST, after_s=struck_s, within_s=within_s)
        interrupted = at_s is None or self.mode_at(at_s) is RobotMode.BRAKING
        return interrupted, at_s if interrupted else None

    async def until_state(self, is_so: Callable[[RobotState], bool], within_s: float) -> bool:
        """Wait for a new state for which `is_so` holds; whether one came within `within_s` [s]."""
        seen_s = time.monotonic()

        def came() -> bool:
            return bool(self._states) and self._states[-1][0] > seen_s and is_so(self._states[-1][1])

        return await self.until(came, within_s)

    def _receive(self, data: bytes) -> None:
        received_s, state = time.monotonic(), codec.decode(data, RobotState)
        if state.mode is not self.mode:
            self._modes.append((received_s, state.mode))
        self._states.append((received_s, state))
        self.note_change()


class FlowLog(Changing):
    """Every step that the flow has entered."""

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        self.boxes: list[tuple[float, FlowStatus]] = []
        transport.tap(topics.FLOW, self._receive)

    @property
    def step(self) -> str:
        """The current step of the flow; empty before the first."""
        return self.boxes[-1][1].step if self.boxes else ""

    @property
    def ended(self) -> bool:
        """Whether the flow has reached one of its ends."""
        return bool(self.boxes) and self.boxes[-1][1].outcome is not None

    async def begun(self) -> None:
        """Return when the flow is in its first step."""
        await self.until(lambda: bool(self.boxes))

    async def end(self) -> None:
        """Return when the flow has ended."""
        await self.until(lambda: self.ended)

    async def comes_to(self, steps: frozenset[str], times: int = 1) -> bool:
        """Wait until the flow enters one of the steps for the `times`-th time; False when it ended earlier."""

        def there() -> bool:
            visits = sum(status.step in steps for _, status in self.boxes)
            return self.ended or (self.step in steps and visits >= times)

        await self.until(there)
        return not self.ended

    def _receive(self, data: bytes) -> None:
        self.boxes.append((time.monotonic(), codec.decode(data, FlowStatus)))
        self.note_change()
