"""The bus between processes, over zenoh."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ParamSpec, TypeVar

import zenoh

from dlokit.communication.calls import SkillCaller
from dlokit.communication.skill import Skill, SkillCall
from dlokit.communication.timing.clock import Clock, LoopClock
from dlokit.communication.timing.urgency import HEARTBEAT_PRIORITY, BoundedUrgency, threads_urgent
from dlokit.communication.topic import Topic
from dlokit.communication.transport import CallHandler, Latest, Liveness, Mailbox, Report
from dlokit.communication.wire import codec
from dlokit.communication.wire.schema import fingerprint
from dlokit.communication.zenoh import calls
from dlokit.communication.zenoh.calls import CallServer
from dlokit.communication.zenoh.liveness import Presence, announce_caller, watch_callers
from dlokit.communication.zenoh.session import OpenSession, ZenohConfig, open_session
from dlokit.communication.zenoh.topics import Connection, Refusals, TopicReader, TopicWriter, unpack_sample
from dlokit.errors import CommunicationError
from dlokit.types.message import Message
from dlokit.types.outcome import Cancelled, TimedOut, Unreachable

T = TypeVar("T", bound=Message)
P = ParamSpec("P")

SLOWEST_CLOCK = 20.0
"""Time-outs of calls are limited to this multiple in machine time, in case the skills' clock is slow or stopped."""

THREAD_JOIN_TIMEOUT_S = 2.0
"""Longest wait for a reader's thread [s], which ends within 0.1 s of its session."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Patience:
    """Time limits of a transport's waits for other processes [s of machine time]."""

    answer_s: float = 0.5
    """A caller waits longer than the skill's time-out by this much, so that the component's own answer comes first."""
    cancel_s: float = 2.0
    """Longest wait for a cancelled skill to stop."""
    discovery_s: float = 0.5
    """A component that was never present counts as unreachable after this time."""
    query_s: float = calls.QUERY_TIMEOUT_S
    """Time-out of a query, after which the caller queries the call again."""


PATIENCE = Patience()


class ZenohTransport(SkillCaller):
    """Publish, read and call between processes. Create, use and close it on the same running event loop.

    When a caller's session ends, because it is closed or its process is killed, its running calls are cancelled.
    """

    def __init__(
        self,
        config: ZenohConfig,
        clock: Clock | None = None,
        open_session: OpenSession = open_session,
        patience: Patience = PATIENCE,
    ) -> None:
        """`clock` measures the time-outs of skills; the default is the loop's own."""
        self._patience = patience
        self._loop = asyncio.get_running_loop()
        self._clock: Clock = clock or LoopClock()
        self._session = open_session(config)
        super().__init__(identity=str(self._session.zid()))
        self._writers: dict[str, TopicWriter] = {}
        self._readers: dict[str, TopicReader[Any]] = {}
        self._servers: dict[str, CallServer] = {}
        self._taps: list[zenoh.Subscriber[Any]] = []
        self._refusals = Refusals()
        self._connection = Connection(self._session, self._loop, self._refusals)
        self._presence = Presence(self._session, self._loop)
        self._closed = False
        self._calling = announce_caller(self._session)
        self._callers = watch_callers(self._session, self._loop, self._cancel_calls_of)

    def publish(self, topic: Topic[T], message: T) -> None:
        """Send a message to all readers in all processes."""
        writer = self._writers.get(topic.name)
        if writer is None:
            writer = self._writers[topic.name] = TopicWriter(self._connection, topic)
        writer.put(message)

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """The newest message; the first call on a topic subscribes, and the last published one arrives soon after."""
        return self._reader(topic).latest()

    def stream(self, topic: Topic[T], *, with_last: bool = False) -> Mailbox[T]:
        """Messages from now on; with `with_last`, the last published message first."""
        return self._reader(topic).open_mailbox(with_last=with_last)

    def tap(self, topic: Topic[Any], listener: Callable[[bytes], None]) -> None:
        """Pass every message of a topic, still encoded, to `listener`, on a network thread.

        Unlike a reader, it loses none when this process's loop is busy. Messages with another schema are skipped.
        """
        schema, limit = fingerprint(topic.type), codec.largest_bytes(topic.type)
        urgency = BoundedUrgency(priority=HEARTBEAT_PRIORITY)

        def on_sample(sample: zenoh.Sample) -> None:
            urgency(True)  # its thread is this tap's own; pictures, or a flood, must not starve the machine
            try:
                data = unpack_sample(sample, schema, limit)[1]
            except CommunicationError as error:
                self._refusals.note(topic.name, error)
            else:
                listener(data)

        with threads_urgent():  # it receives the commander's heartbeats
            self._taps.append(self._session.declare_subscriber(f"topic/{topic.name}", on_sample))

    @property
    def refused(self) -> Mapping[tuple[str, str], int]:
        """Number of messages and peers that could not be decoded, by topic and name of the error."""
        return self._refusals.counts

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """Call without waiting for the outcome; thread-safe and independent of the loop, which may be busy."""
        call_id = f"{self.identity}-{next(self._call_numbers)}"
        with contextlib.suppress(CommunicationError):  # arguments that do not fit: no one waits for the rejection
            calls.send(self._session, skill.request(call_id, self.identity, *args, **kwargs))

    async def _deliver(self, skill: Skill[..., Any], call: SkillCall, report: Report) -> bytes | TimedOut | Unreachable:
        """Call with zenoh queries. On a time-out or cancellation, wait until the skill has stopped.

        Progress reports that the network cannot accept in time are dropped.
        """
        limit_s = skill.timeout_s + self._patience.answer_s
        asked: calls.Call | None = None
        try:
            async with asyncio.timeout(SLOWEST_CLOCK * limit_s), self._clock.timeout(limit_s):
                if call.component not in self._presence.servers:  # peers take time to find each other
                    await self._presence.wait_for(call.component, self._patience.discovery_s)
                if self._closed:
                    return Unreachable(component=call.component)
                server = partial(self._presence.server, call.component)
                query_s = self._patience.query_s
                asked = calls.Call(self._session, self._loop, call, report, server, server(), query_s)
                asked.ask()
                answer = await asyncio.shield(asked.answered)
        except TimeoutError:
            await self._cancel_call(asked)
            return TimedOut(timeout_s=skill.timeout_s)
        except asyncio.CancelledError:
            await self._cancel_call(asked)
            raise
        return Unreachable(component=call.component) if answer is None else answer

    def alive(self, component: str) -> Liveness:
        """Liveness by liveliness tokens: a killed process is detected within milliseconds, a frozen one after 10 s."""
        if component in self._servers:
            return Liveness(True)
        server = self._presence.server(component)
        return Liveness(bool(server), server)

    def serving(self, component: str) -> int:
        """Number of other processes that serve a component; it should be one."""
        return len(self._presence.servers.get(component, ()))

    async def wait_for(self, component: str, timeout_s: float) -> bool:
        """Wait up to `timeout_s` of machine time until a component is present; returns whether it is."""
        return component in self._servers or await self._presence.wait_for(component, timeout_s)

    def serve(self, component: str, handler: CallHandler) -> None:
        """Answer calls to `component`, from any process."""
        cancelled = codec.encode(Cancelled())
        self._servers[component] = CallServer(self._session, component, handler, cancelled, self._loop)

    def _cancel_calls_of(self, identity: str) -> None:
        for server in self._servers.values():
            server.cancel_all_of(identity)

    async def withdraw(self, component: str) -> None:
        """Stop answering calls to a component; running calls are cancelled."""
        server = self._servers.pop(component, None)
        if server is not None:
            await server.close(self._patience.cancel_s)

    async def close(self) -> None:
        """Cancel running calls, end all streams, close the session."""
        if self._closed:
            return
        self._closed = True
        for component in list(self._servers):
            await self.withdraw(component)
        for reader in self._readers.values():
            reader.close()
        # Closing waits for callbacks, which may wait for the loop's thread; hence it runs on another thread.
        await asyncio.to_thread(self._close_session)

    def _close_session(self) -> None:
        self._session.close()
        for name, reader in self._readers.items():
            if not reader.join(THREAD_JOIN_TIMEOUT_S):
                log.warning("the thread that reads %s did not end within %g s", name, THREAD_JOIN_TIMEOUT_S)

    def _reader(self, topic: Topic[T]) -> TopicReader[T]:
        reader = self._readers.get(topic.name)
        if reader is None:
            reader = self._readers[topic.name] = TopicReader(self._connection, topic)
            if self._closed:
                reader.close()
        return reader

    async def _cancel_call(self, asked: calls.Call | None) -> None:
        if asked is not None:
            calls.cancel(self._session, asked.call.component, asked.call.call_id)
            await asyncio.wait({asked.answered}, timeout=self._patience.cancel_s)
            asked.answered.cancel()
