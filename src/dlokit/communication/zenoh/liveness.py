"""Liveness of components and callers by zenoh's liveliness tokens, which vanish when their process ends."""

import asyncio
import threading
from collections.abc import Callable

import zenoh


class Presence:
    """The components present on the bus. Thread-safe: zenoh's threads update it."""

    def __init__(self, session: zenoh.Session, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._lock = threading.Lock()
        self.servers: dict[str, tuple[str, ...]] = {}
        """Component → ids of the processes that serve it, the newest last; empty when it is no longer present. Two
        serve it briefly during a restart; otherwise more than one is an error."""
        self._changed = asyncio.Event()
        # Two processes may serve one component briefly, while it is restarted: each has its own token.
        self._subscriber = session.liveliness().declare_subscriber("alive/*/*", self._on_token, history=True)

    def server(self, component: str) -> str:
        """Id of the process that serves it, the newest of several; empty if it is not present."""
        return (self.servers.get(component) or ("",))[-1]

    async def wait_for(self, component: str, timeout_s: float) -> bool:
        """Wait up to `timeout_s` of machine time until it is present; returns whether it is."""
        try:
            async with asyncio.timeout(timeout_s):
                while not self.server(component):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def _on_token(self, sample: zenoh.Sample) -> None:
        name, identity = str(sample.key_expr).split("/")[-2:]
        with self._lock:
            servers = dict.fromkeys(self.servers.get(name, ()))
            if sample.kind == zenoh.SampleKind.PUT:
                servers[identity] = None
            else:
                servers.pop(identity, None)
            self.servers[name] = tuple(servers)
        self._loop.call_soon_threadsafe(self._changed.set)


def watch_callers(
    session: zenoh.Session, loop: asyncio.AbstractEventLoop, on_gone: Callable[[str], None]
) -> "zenoh.Subscriber[None]":
    """Call `on_gone` on the loop with the id of each caller whose session has ended, for whatever reason."""

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            identity = str(sample.key_expr).rpartition("/")[2]
            loop.call_soon_threadsafe(on_gone, identity)

    # `history` includes the present callers: zenoh reports the end only of tokens that it has reported before.
    return session.liveliness().declare_subscriber("caller/*", on_token, history=True)


def announce_caller(session: zenoh.Session) -> zenoh.LivelinessToken:
    """Declare this session as a caller to the called components; the token vanishes with the session."""
    return session.liveliness().declare_token(f"caller/{session.zid()}")
