"""The bus between processes, over zenoh."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

import zenoh

from dlokit.communication.calls import SkillCaller, encode_call
from dlokit.communication.skill import Skill
from dlokit.communication.timing.clock import Clock, LoopClock
from dlokit.communication.timing.urgency import threads_urgent
from dlokit.communication.topic import Topic
from dlokit.communication.transport import CallHandler, Known, Latest, Liveness, Mailbox, Report
from dlokit.communication.wire import codec
from dlokit.communication.wire.schema import fingerprint
from dlokit.communication.zenoh import calls
from dlokit.communication.zenoh.calls import CallServer
from dlokit.communication.zenoh.connection import Connection, Refusals
from dlokit.communication.zenoh.liveness import Presence, announce_caller, watch_callers
from dlokit.communication.zenoh.session import OpenSession, ZenohConfig, open_session
from dlokit.communication.zenoh.topics import TopicReader, TopicWriter, unpacked
from dlokit.errors import CommunicationError
from dlokit.types.message import Message
from dlokit.types.outcome import Cancelled, Rejected, TimedOut, Unreachable

T = TypeVar("T", bound=Message)
P = ParamSpec("P")

CALL_MARGIN_S = 0.5
"""A caller waits this much longer than the called one may run, so that the called one's answer comes first."""

SLOWEST_CLOCK = 20.0
"""A clock that runs slower than the machine's by more than this, or stands, ends calls as well."""

CANCEL_PATIENCE_S = 2.0
"""A caller that gives up waits this long for the skill to have stopped (machine time)."""

FOUND_PATIENCE_S = 0.5
"""A component that was never seen gets this long to be found before it counts as unreachable."""

THREAD_PATIENCE_S = 2.0
"""A reader's thread ends within a tenth of a second of its session."""

log = logging.getLogger(__name__)


class ZenohTransport(SkillCaller):
    """Publish, read and call between processes. Made and used on a running event loop; close it there.

    A caller whose session ends, because it is closed or its process is killed, has its running calls cancelled.
    """

    def __init__(
        self, config: ZenohConfig, clock: Clock | None = None, open_session: OpenSession = open_session
    ) -> None:
        """`clock` is the one that the time-outs of skills are counted on; the loop's own by default."""
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
        self._callers = watch_callers(self._session, self._loop, self._caller_gone)

    def publish(self, topic: Topic[T], message: T) -> None:
        """Send a message to all readers in all processes."""
        writer = self._writers.get(topic.name)
        if writer is None:
            writer = self._writers[topic.name] = TopicWriter(self._connection, topic)
        writer.put(message)

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """The newest message; the first call on a topic subscribes, and a message of before arrives soon after."""
        return self._reader(topic).latest()

    def stream(self, topic: Topic[T], *, with_last: bool = False) -> Mailbox[T]:
        """Messages from now on; with `with_last`, the last one before, first."""
        return self._reader(topic).open_mailbox(with_last=with_last)

    def tap(self, topic: Topic[Any], listener: Callable[[bytes], None]) -> None:
        """Hand every message of a topic, still encoded, to `listener`, on a thread of the network's.

        Unlike a reader it misses none when this process's loop is busy. Messages of another schema are left out.
        """
        schema, limit = fingerprint(topic.type), codec.largest_bytes(topic.type)

        def on_sample(sample: zenoh.Sample) -> None:
            try:
                data = unpacked(sample, schema, limit)[1]
            except CommunicationError as error:
                self._refusals.note(topic.name, error)
            else:
                listener(data)

        with threads_urgent():  # the commander's heartbeats are heard on it
            self._taps.append(self._session.declare_subscriber(f"topic/{topic.name}", on_sample))

    @property
    def refused(self) -> Mapping[tuple[str, str], int]:
        """Messages and peers that could not be understood, by topic and name of the error."""
        return self._refusals.counts

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """From any thread, past the loop: for what must get through while the loop is busy."""
        call_id = f"{self.identity}-{next(self._call_numbers)}"
        request = encode_call(skill, call_id, self.identity, *args, **kwargs)
        if not isinstance(request, Rejected):
            calls.send(self._session, skill, request, call_id)

    async def _deliver(
        self, skill: Skill[..., Any], request: bytes, call_id: str, report: Report
    ) -> bytes | TimedOut | Unreachable:
        """By a query. A caller that gives up waits until the skill has stopped.

        Pieces of progress that the network cannot take in time are dropped.
        """
        limit_s = skill.timeout_s + CALL_MARGIN_S
        asked: asyncio.Future[bytes | None] | None = None
        try:
            async with asyncio.timeout(SLOWEST_CLOCK * limit_s), self._clock.timeout(limit_s):
                await self._presence.found(skill.component, FOUND_PATIENCE_S)
                if self._closed:
                    return Unreachable(component=skill.component)
                asked = calls.ask(self._session, self._loop, skill, request, call_id, report)
                answer = await asyncio.shield(asked)
        except TimeoutError:
            await self._give_up(skill.component, call_id, asked)
            return TimedOut(timeout_s=skill.timeout_s)
        except asyncio.CancelledError:
            await self._give_up(skill.component, call_id, asked)
            raise
        return Unreachable(component=skill.component) if answer is None else answer

    def alive(self, component: str) -> Liveness:
        """By liveliness tokens: a killed process is known within milliseconds, a frozen one after 10 s."""
        if component in self._servers:
            return Known(True)
        server = self._presence.server(component)
        return Known(bool(server), server)

    def serving(self, component: str) -> int:
        """How many other processes serve a component; there should be one."""
        return self._presence.count(component)

    async def wait_for(self, component: str, timeout_s: float) -> bool:
        """Wait until a component is there, for at most `timeout_s` of the machine's time; whether it is."""
        return component in self._servers or await self._presence.wait_for(component, timeout_s)

    def serve(self, component: str, handler: CallHandler) -> None:
        """Answer calls to `component`, from any process."""
        cancelled = codec.encode(Cancelled())
        self._servers[component] = CallServer(self._session, component, handler, cancelled, self._loop)

    def _caller_gone(self, identity: str) -> None:
        for server in self._servers.values():
            server.cancel_all_of(identity)

    async def withdraw(self, component: str) -> None:
        """Answer no more; calls that run are cancelled."""
        server = self._servers.pop(component, None)
        if server is not None:
            await server.close(CANCEL_PATIENCE_S)

    async def close(self) -> None:
        """Cancel what runs, end all streams, leave the network."""
        if self._closed:
            return
        self._closed = True
        for component in list(self._servers):
            await self.withdraw(component)
        for reader in self._readers.values():
            reader.close()
        # Closing waits for callbacks, which may wait for the loop's thread: so it happens beside the loop.
        await asyncio.to_thread(self._leave)

    def _leave(self) -> None:
        self._session.close()
        for name, reader in self._readers.items():
            if not reader.join(THREAD_PATIENCE_S):
                log.warning("the thread that reads %s does not end", name)

    def _reader(self, topic: Topic[T]) -> TopicReader[T]:
        reader = self._readers.get(topic.name)
        if reader is None:
            reader = self._readers[topic.name] = TopicReader(self._connection, topic)
            if self._closed:
                reader.close()
        return reader

    async def _give_up(self, component: str, call_id: str, asked: "asyncio.Future[bytes | None] | None") -> None:
        if asked is not None:
            calls.cancel(self._session, component, call_id)
            await asyncio.wait({asked}, timeout=CANCEL_PATIENCE_S)
            asked.cancel()
