"""What the arm does and feels, and what its commander attempts, by the machine's clock."""

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.types.outcome import Failed, Outcome, Rejected
from dlokit.types.robot import RobotMode, RobotState

AT_REST = (RobotMode.IDLE, RobotMode.FAULT)


KEPT = 6000
"""States that are kept: two minutes."""


class ArmLog:
    """The states that the arm's sensors publish, and the changes of its mode, with the time at which each was received.

    The cell publishes 50 states a second of its own clock: a time is late by up to 20 ms, and never early. Times are of
    the machine's monotonic clock [s]. Made and used on a running event loop.
    """

    def __init__(self, transport: Transport) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
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

        return found[0] if await _until(begun, self._changed, within_s) else None

    async def until(self, is_so: Callable[[RobotState], bool], within_s: float) -> bool:
        """Wait for a new state for which `is_so` holds; whether one came within `within_s` [s]."""
        seen_s = time.monotonic()

        def came() -> bool:
            return bool(self._states) and self._states[-1][0] > seen_s and is_so(self._states[-1][1])

        return await _until(came, self._changed, within_s)

    def _receive(self, data: bytes) -> None:
        received_s, state = time.monotonic(), codec.decode(data, RobotState)
        if state.mode is not self.mode:
            self._modes.append((received_s, state.mode))
        self._states.append((received_s, state))
        self._loop.call_soon_threadsafe(self._changed.set)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One call of a skill."""

    skill: str
    """Its key, e.g. ``robot.grasp``."""
    began_s: float
    """By the machine's monotonic clock [s]."""
    ended_s: float | None = None
    """By the same clock [s]; None: it still runs."""
    ended_as: str = ""
    """The kind of its outcome and the reason, e.g. ``Rejected stop_latched``."""


def outcome_name(outcome: Outcome[Any]) -> str:
    """The kind of an outcome, and its reason where it has one."""
    match outcome:
        case Failed(reason=reason) | Rejected(reason=reason):
            return f"{type(outcome).__name__} {reason}"
        case _:
            return type(outcome).__name__


async def _until(is_so: Callable[[], bool], changed: asyncio.Event, within_s: float) -> bool:
    """Wait until `is_so` holds, which is looked at after each change; whether it did within `within_s` [s]."""
    try:
        async with asyncio.timeout(within_s):
            while not is_so():
                changed.clear()
                await changed.wait()
    except TimeoutError:
        return False
    return True


class AttemptLog:
    """The attempts of the commander that runs now. Made and used on a running event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._reports: Connection | None = None
        self._ended: list[Attempt] = []
        self._running: Attempt | None = None
        self._changed = asyncio.Event()

    @property
    def running(self) -> str:
        """Key of the skill that runs; empty when none does, as far as was reported."""
        return self._running.skill if self._running is not None else ""

    def listen(self, reports: Connection) -> None:
        """Read the reports of a new commander, in the place of those of the previous one."""
        self.close()
        self._reports = reports
        self._loop.add_reader(reports.fileno(), self._read, reports)

    def close(self) -> None:
        """Read no more."""
        if self._reports is not None:
            self._loop.remove_reader(self._reports.fileno())
            self._reports.close()
        self._reports, self._running = None, None

    def between(self, begin_s: float, end_s: float) -> list[Attempt]:
        """Attempts that began and ended between two times of the machine's monotonic clock [s]."""
        return [
            attempt
            for attempt in self._ended
            if attempt.began_s >= begin_s and attempt.ended_s is not None and attempt.ended_s <= end_s
        ]

    async def until(self, is_so: Callable[[], bool], within_s: float) -> bool:
        """Wait until `is_so` holds, which is looked at after each report; whether it did within `within_s` [s]."""
        return await _until(is_so, self._changed, within_s)

    def _read(self, reports: Connection) -> None:
        try:
            while reports.poll():
                self._note(reports.recv())
        except (EOFError, OSError):  # the commander was killed
            self.close()
        self._changed.set()

    def _note(self, attempt: Attempt) -> None:
        if attempt.ended_s is None:
            self._running = attempt
        else:
            self._running = None
            self._ended.append(attempt)
