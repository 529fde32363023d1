"""What the decision layer tells of its flow, by the machine's clock."""

import asyncio
import time
from collections.abc import Callable

from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.types.flow import FlowStatus

MENDING = frozenset({"restore", "recover"})
"""The boxes in which the flow waits for what was lost, or clears an arm that has braked."""


class FlowLog:
    """Every box that the flow has come to, with the time at which that was heard."""

    def __init__(self, transport: Transport) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self.boxes: list[tuple[float, FlowStatus]] = []
        transport.tap(topics.FLOW, self._hear)

    @property
    def step(self) -> str:
        """The box that the flow is in; empty before the first."""
        return self.boxes[-1][1].step if self.boxes else ""

    @property
    def ended(self) -> bool:
        """Whether the flow has come to one of its ends."""
        return bool(self.boxes) and self.boxes[-1][1].outcome is not None

    async def begun(self) -> None:
        """Return when the flow is in its first box."""
        await self._until(lambda: bool(self.boxes))

    async def comes_to(self, steps: frozenset[str], times: int) -> bool:
        """Wait until the flow has come to one of the boxes for the `times`-th time; False when it ended before."""

        def there() -> bool:
            return self.ended or (self.step in steps and self._visits(steps) >= times)

        await self._until(there)
        return not self.ended

    async def end(self) -> None:
        """Return when the flow has ended."""
        await self._until(lambda: self.ended)

    def _visits(self, steps: frozenset[str]) -> int:
        return sum(status.step in steps for _, status in self.boxes)

    async def _until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self._changed.clear()
            await self._changed.wait()

    def _hear(self, data: bytes) -> None:
        self.boxes.append((time.monotonic(), codec.decode(data, FlowStatus)))
        self._loop.call_soon_threadsafe(self._changed.set)


def mended_after_s(boxes: list[tuple[float, str]], struck_s: float) -> float:
    """From a fault until the flow has left the last box in which it mended something [s]; 0 where it never had to.

    `boxes` are the times of the machine's clock [s] at which the flow came to each box. A flow that ended in such a
    box, or was cut off there, has not been mended: inf.
    """
    after = [(at_s, step) for at_s, step in boxes if at_s >= struck_s]
    mending = [index for index, (_, step) in enumerate(after) if step in MENDING]
    if not mending:
        return 0.0
    last = mending[-1] + 1
    return after[last][0] - struck_s if last < len(after) else float("inf")
