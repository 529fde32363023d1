"""An event loop on virtual time: it jumps to the next timer instead of waiting.

Runs on it are deterministic and as fast as the machine allows. Never await a thread or a process on it: virtual time
would advance in the meantime.
"""

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

from dlokit.errors import DlokitError

T = TypeVar("T")


class VirtualDeadlock(DlokitError):
    """Raised when every task waits for another and no timer is set: the run would never end."""


class _JumpingSelector(selectors.DefaultSelector):
    """A selector that returns ready events, and advances the loop's clock where the loop would sleep."""

    loop: "VirtualTimeLoop"

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        # Poll the real selector too, so that Ctrl-C (a byte on the loop's own pipe) is seen.
        ready = super().select(0)
        if ready:
            return ready
        if timeout is None:
            raise VirtualDeadlock("every task waits for another and no timer is set; give the wait a time-out")
        if timeout > 0:
            self.loop.advance(timeout)
        return []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """A selector event loop whose `time` starts at 0 and advances only by jumps."""

    def __init__(self) -> None:
        self._virtual_s = 0.0
        selector = _JumpingSelector()
        selector.loop = self
        super().__init__(selector)

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._virtual_s

    def advance(self, duration_s: float) -> None:
        """Advance the virtual time."""
        self._virtual_s += duration_s


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on virtual time; Ctrl-C cancels it."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return run_with(runner, main)


def run_with(runner: asyncio.Runner, main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end with a runner, which forms no `repr` of the result.

    `asyncio.Runner` does so when it restores the handling of Ctrl-C, and a result can be a whole run.
    """
    results = list[T]()

    async def ended() -> None:
        results.append(await main)

    runner.run(ended())
    return results[0]
