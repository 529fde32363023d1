"""Topics over zenoh: writers that store their last message, readers that always receive the newest ones.

A reader that joins late would miss the message published before. Therefore each writer announces itself with a
liveliness token and answers queries for its last message, and a reader queries each announced writer. Readers have
tokens too; a token contains the schema, so that each end detects another version at the other end.
"""

import asyncio
import logging
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar
from weakref import WeakKeyDictionary

import msgspec
import zenoh

from dlokit.communication.timing.urgency import HEARTBEAT_PRIORITY, BoundedUrgency, threads_urgent
from dlokit.communication.topic import Every, Topic
from dlokit.communication.transport import Latest, Mailbox
from dlokit.communication.wire import codec
from dlokit.communication.wire.envelope import Envelope, mismatch, pack_envelope, unpack_envelope
from dlokit.communication.wire.schema import fingerprint
from dlokit.errors import CommunicationError
from dlokit.types.message import Message

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

ASK_TIMEOUT_S = 5.0
"""Longest wait for a writer's last message [s]; it arrives within a millisecond unless the writer's process hangs."""
BURST = 64
"""Number of messages of an `Every` topic that zenoh buffers while no Python thread can run."""


class Refusals:
    """Counts of refused messages by topic and kind of error. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[tuple[str, str]] = Counter()

    def note(self, topic: str, error: CommunicationError) -> None:
        """Count a message or peer that this version cannot decode; the first of each kind is logged."""
        key = (topic, type(error).__name__)
        with self._lock:
            self._counts[key] += 1
            first = self._counts[key] == 1
        if first:
            log.error("messages on %s dropped: %s", topic, error)

    @property
    def counts(self) -> Mapping[tuple[str, str], int]:
        """Number of refused messages by topic and name of the error."""
        with self._lock:
            return dict(self._counts)


@dataclass(frozen=True)
class Connection:
    """The session, event loop and refusal counts that the topics of one process share."""

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    """Callbacks on zenoh's threads pass their results to it with `call_soon_threadsafe`."""
    refusals: Refusals


class ReceivedMessage(msgspec.Struct, frozen=True):
    """A message as received, still encoded; it is decoded only when a reader needs it."""

    envelope: Envelope
    data: bytes
    arrived_s: float


class TopicWriter:
    """Publishes one topic and sends its last message to late readers."""

    def __init__(self, connection: Connection, topic: Topic[Any]) -> None:
        session = connection.session
        every = isinstance(topic.policy, Every)
        # A `KeepLast` message may be dropped under congestion, since the next one replaces it; an `Every` one may not.
        control = zenoh.CongestionControl.BLOCK if every else zenoh.CongestionControl.DROP
        self._schema = fingerprint(topic.type)
        self._lock = threading.Lock()
        self._buffer = bytearray()
        self._last: tuple[zenoh.ZBytes, bytes] | None = None
        self._publisher = session.declare_publisher(f"topic/{topic.name}", congestion_control=control)
        self._answers = session.declare_queryable(f"last/{topic.name}", self._answer)
        self._token = session.liveliness().declare_token(f"writer/{topic.name}/{self._schema.hex()}/{session.zid()}")
        self._readers = watch_schemas(connection, "reader", topic.name, self._schema)

    def put(self, message: Message) -> None:
        """Send a message to all readers; thread-safe."""
        with self._lock:
            codec.encode_into(message, self._buffer)
            payload, envelope = zenoh.ZBytes(self._buffer), pack_envelope(self._schema)
            self._last = (payload, envelope)
            self._publisher.put(payload, attachment=envelope)

    def _answer(self, query: zenoh.Query) -> None:
        last = self._last
        if last is not None:
            query.reply(query.key_expr, last[0], attachment=last[1])
        query.drop()


class TopicReader(Generic[T]):
    """Receives one topic for all readers in this process.

    zenoh buffers the newest messages without Python, so that a busy loop, or a thread that holds the interpreter's
    lock, cannot delay the network or let messages accumulate. A thread of the reader passes them to the loop; a loop
    that was busy fetches them itself. The loop decodes only the messages that are still needed by then.
    """

    def __init__(self, connection: Connection, topic: Topic[T]) -> None:
        self._connection = connection
        self._topic = topic
        self._loop = connection.loop
        self._every = isinstance(topic.policy, Every)
        depth = topic.policy.depth if isinstance(topic.policy, Every) else 1
        self._schema = fingerprint(topic.type)
        self._limit = codec.largest_bytes(topic.type)
        self._received: deque[ReceivedMessage] = deque(maxlen=depth)
        self._newest: ReceivedMessage | None = None
        self._value: T | None = None
        self._mailboxes = WeakKeyDictionary[Mailbox[T], None]()  # of the readers that are not garbage-collected
        self._waiting_for_last = WeakKeyDictionary[Mailbox[T], None]()
        session = connection.session
        ring = zenoh.handlers.RingChannel(max(depth, BURST) if self._every else 1)
        self._subscriber = session.declare_subscriber(f"topic/{topic.name}", ring)
        self._thread = threading.Thread(target=self._receive, name=f"reads {topic.name}", daemon=True)
        with threads_urgent():  # it holds the interpreter's lock, for which heartbeats and commands would wait
            self._thread.start()
        self._token = session.liveliness().declare_token(f"reader/{topic.name}/{self._schema.hex()}/{session.zid()}")
        self._writers = watch_schemas(connection, "writer", topic.name, self._schema, self._query_last)

    def latest(self) -> Latest[T]:
        """The newest message and its age."""
        self._refresh()
        if self._value is None or self._newest is None:
            return Latest(None, float("inf"))
        return Latest(self._value, self._loop.time() - self._sent_s(self._newest))

    def open_mailbox(self, *, with_last: bool) -> Mailbox[T]:
        """A mailbox for messages from now on; with `with_last`, the last published message first."""
        self._refresh()
        mailbox: Mailbox[T] = Mailbox(self._topic.policy, self._refresh)
        if with_last and self._value is not None and self._newest is not None:
            mailbox.put(self._value, self._sent_s(self._newest))
        elif with_last:
            self._waiting_for_last[mailbox] = None
        self._mailboxes[mailbox] = None
        return mailbox

    def close(self) -> None:
        """End all streams."""
        for mailbox in self._mailboxes:
            mailbox.close()

    def join(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s` for the thread, which ends with the session; returns whether it has ended."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _receive(self) -> None:
        urgency = BoundedUrgency(priority=HEARTBEAT_PRIORITY)  # pictures, or a flood, must not starve the machine
        for sample in self._subscriber.handler:
            urgency(True)
            received = self._unpack(sample)
            if received is not None:
                self._received.append(received)
                self._connection.loop.call_soon_threadsafe(self._drain)

    def _unpack(self, sample: zenoh.Sample) -> ReceivedMessage | None:
        try:
            envelope, data = unpack_sample(sample, self._schema, self._limit)
        except CommunicationError as error:
            self._connection.refusals.note(self._topic.name, error)
            return None
        return ReceivedMessage(envelope, data, self._loop.time())

    def _drain(self) -> None:
        while self._received:
            self._take(self._received.popleft())

    def _refresh(self) -> None:
        """Take all received messages; of a `KeepLast` topic also a newer one that the thread has not fetched yet."""
        self._drain()
        if self._every:
            return
        try:
            sample = self._subscriber.handler.try_recv()
        except zenoh.ZError:  # the session has been closed
            return
        received = None if sample is None else self._unpack(sample)
        if received is not None:
            self._take(received)

    def _take(self, received: ReceivedMessage) -> None:
        newest = self._newest
        if not self._every and newest is not None and received.envelope.is_not_newer_than(newest.envelope):
            return  # the loop has fetched a newer one before the thread passed this one on
        message = self._decode(received)
        if message is not None:
            self._waiting_for_last.clear()
            self._deliver(message, received, self._mailboxes)

    def _query_last(self) -> None:
        if self._connection.session.is_closed():
            return
        known = self._newest

        def on_reply(reply: zenoh.Reply) -> None:
            received = None if reply.ok is None else self._unpack(reply.ok)
            if received is not None:
                self._connection.loop.call_soon_threadsafe(self._take_last, received, known)

        self._connection.session.get(f"last/{self._topic.name}", on_reply, timeout=ASK_TIMEOUT_S)

    def _take_last(self, received: ReceivedMessage, known: ReceivedMessage | None) -> None:
        if self._newest is not known or (known and received.envelope.is_not_newer_than(known.envelope)):
            return  # a newer one has arrived since the query, or this one had arrived before
        message = self._decode(received)
        if message is not None:
            # A writer that restarted, or whose link was closed, may have published before the link was open: then all
            # readers have missed the message. On an `Every` topic it may also arrive as usual, and count twice.
            missed_by_all = known is not None and not self._every
            self._deliver(message, received, self._mailboxes if missed_by_all else self._waiting_for_last)
            self._waiting_for_last.clear()

    def _decode(self, received: ReceivedMessage) -> T | None:
        try:
            return codec.decode(received.data, self._topic.type)
        except CommunicationError as error:
            self._connection.refusals.note(self._topic.name, error)
            return None

    def _deliver(self, message: T, received: ReceivedMessage, mailboxes: Iterable[Mailbox[T]]) -> None:
        self._value, self._newest = message, received
        sent_s = self._sent_s(received)
        for mailbox in mailboxes:
            mailbox.put(message, sent_s)

    @staticmethod
    def _sent_s(received: ReceivedMessage) -> float:
        return received.envelope.sent_s(received.arrived_s)


def unpack_sample(sample: zenoh.Sample, schema: bytes, limit: int) -> tuple[Envelope, bytes]:
    """Envelope and bytes of a message. Raises `CommunicationError` if it has another schema or is too long."""
    attachment, payload = sample.attachment, sample.payload
    envelope = unpack_envelope(None if attachment is None else attachment.to_bytes(), schema)
    if len(payload) > limit:
        raise CommunicationError(f"a message of {len(payload)} bytes refused; the longest allowed has {limit}")
    return envelope, payload.to_bytes()


def watch_schemas(
    connection: Connection, end: str, topic: str, ours: bytes, on_match: Callable[[], None] | None = None
) -> "zenoh.Subscriber[None]":
    """Count peers at the topic's other `end` with another schema; call `on_match` on the loop for each other peer."""

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        theirs = str(sample.key_expr).split("/")[-2]
        if theirs != ours.hex():
            connection.loop.call_soon_threadsafe(connection.refusals.note, topic, mismatch(theirs, ours))
        elif on_match is not None:
            connection.loop.call_soon_threadsafe(on_match)

    return connection.session.liveliness().declare_subscriber(f"{end}/{topic}/*/*", on_token, history=True)
