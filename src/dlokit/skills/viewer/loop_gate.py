"""From a thread of the page's server to the component's event loop."""

import asyncio
from collections.abc import Callable
from typing import ParamSpec

P = ParamSpec("P")


class LoopGate:
    """Lets other threads run functions on one event loop. What comes after it was shut is dropped."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._open = True

    def post(self, function: Callable[P, object], *args: P.args, **kwargs: P.kwargs) -> None:
        """Run ``function(*args, **kwargs)`` on the loop, soon. Callable on any thread."""
        if not self._open:
            return
        try:
            self._loop.call_soon_threadsafe(self._run, lambda: function(*args, **kwargs))
        except RuntimeError:
            # The loop was closed between the question and the call: there is nobody to hear it any more.
            self._open = False

    def shut(self) -> None:
        """Run nothing more; also what is posted already."""
        self._open = False

    def _run(self, function: Callable[[], object]) -> None:
        if self._open:
            function()
