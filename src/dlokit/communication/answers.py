"""At most once: a call that comes again is answered from the record, and not run again."""

import asyncio
from collections import OrderedDict
from collections.abc import Awaitable, Callable

LARGEST_TOTAL_BYTES = 8_000_000
"""Of the answers kept; the oldest go first."""
CALLS_KNOWN = 4096
"""Calls whose number is remembered, with or without their answers."""


class Answers:
    """Encoded outcomes of the calls to one component, by the calls' numbers."""

    def __init__(self, forgotten: bytes, cancelled: bytes) -> None:
        """`forgotten` answers a call whose outcome is no longer kept; `cancelled` one whose first was cancelled."""
        self._forgotten = forgotten
        self._cancelled = cancelled
        self._kept: OrderedDict[str, bytes | None] = OrderedDict()
        self._total = 0
        self._running: dict[str, asyncio.Future[bytes]] = {}

    async def once(self, call_id: str, run: Callable[[], Awaitable[bytes]]) -> bytes:
        """The answer to a call: of `run`, of the one that runs already, or of before."""
        if call_id in self._kept:
            return self._kept[call_id] or self._forgotten
        if call_id in self._running:
            return await asyncio.shield(self._running[call_id])
        answered = self._running[call_id] = asyncio.get_running_loop().create_future()
        answer = self._cancelled
        try:
            answer = await run()
        finally:
            answered.set_result(answer)
            del self._running[call_id]
            self._keep(call_id, answer)
        return answer

    def _keep(self, call_id: str, answer: bytes) -> None:
        self._kept[call_id] = answer
        self._total += len(answer)
        while len(self._kept) > CALLS_KNOWN:
            self._total -= len(self._kept.popitem(last=False)[1] or b"")
        for old, kept in self._kept.items():
            if self._total <= LARGEST_TOTAL_BYTES:
                return
            self._total -= len(kept or b"")
            self._kept[old] = None
