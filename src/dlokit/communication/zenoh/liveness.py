"""Who is there, by liveliness tokens of zenoh: one per served component and per caller, gone when their process is."""

import asyncio
import threading
from collections.abc import Callable

import zenoh


class Presence:
    """The components seen on the bus. Zenoh notes from its own threads; everybody may ask."""

    def __init__(self, session: zenoh.Session, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._lock = threading.Lock()
        self._tokens: dict[tuple[str, str], None] = {}  # component and process, the newest last
        self._ever: set[str] = set()
        self._changed = asyncio.Event()
        # Two processes may serve one component for a moment, while it is restarted: each token counts.
        self._subscriber = session.liveliness().declare_subscriber("alive/*/*", self._on_token, history=True)

    def has(self, component: str) -> bool:
        """Whether the component is there."""
        with self._lock:
            return any(name == component for name, _ in self._tokens)

    def server(self, component: str) -> str:
        """The process that serves it, of two the one that came last; empty when it is not there."""
        with self._lock:
            return next((process for name, process in reversed(self._tokens) if name == component), "")

    def count(self, component: str) -> int:
        """How many serve it: two for a moment while it is restarted, and more by somebody's mistake."""
        with self._lock:
            return sum(name == component for name, _ in self._tokens)

    async def found(self, component: str, timeout_s: float) -> None:
        """Wait for a component that was never there, for at most `timeout_s`: peers take time to find each other."""
        if component not in self._ever:
            await self.wait_for(component, timeout_s)

    async def wait_for(self, component: str, timeout_s: float) -> bool:
        """Wait until it is there, for at most `timeout_s` of the machine's time; whether it is."""
        try:
            async with asyncio.timeout(timeout_s):
                while not self.has(component):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def _on_token(self, sample: zenoh.Sample) -> None:
        name, identity = str(sample.key_expr).split("/")[-2:]
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._tokens[name, identity] = None
                self._ever.add(name)
            else:
                self._tokens.pop((name, identity), None)
        self._loop.call_soon_threadsafe(self._changed.set)


def watch_callers(
    session: zenoh.Session, loop: asyncio.AbstractEventLoop, gone: Callable[[str], None]
) -> "zenoh.Subscriber[None]":
    """Tell `gone`, on the loop, of every caller's session that has ended, however it did."""

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            identity = str(sample.key_expr).rpartition("/")[2]
            loop.call_soon_threadsafe(gone, identity)

    # With those that are there already: zenoh tells nothing of the end of a token that it has not told of.
    return session.liveliness().declare_subscriber("caller/*", on_token, history=True)


def announce_caller(session: zenoh.Session) -> zenoh.LivelinessToken:
    """Let the called ones know that this session is there, for as long as it is."""
    return session.liveliness().declare_token(f"caller/{session.zid()}")
