"""Topics over zenoh: writers that remember their last message, readers that never fall behind.

A message published before a reader was there would be lost to it; so each writer answers for its last
one, and announces itself by a liveliness token. A reader asks whoever it sees announced. Readers announce
themselves as well; the tokens name the schema, so that each end knows of another version at the other.
"""

import logging
import threading
import weakref
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgspec
import zenoh

from dlokit.communication.timing.urgency import threads_urgent
from dlokit.communication.topic import Every, Topic
from dlokit.communication.transport import Latest, Mailbox
from dlokit.communication.wire import codec
from dlokit.communication.wire.envelope import Envelope, mismatch, opened, seal
from dlokit.communication.wire.schema import fingerprint
from dlokit.communication.zenoh.connection import Connection
from dlokit.errors import CommunicationError
from dlokit.types.message import Message

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

ASK_TIMEOUT_S = 5.0
"""Longest wait for a writer's last message; it comes within a millisecond, or its process hangs."""
BURST = 64
"""Messages of a topic of which every one counts, that may come at once while no thread of ours can run."""


class Letter(msgspec.Struct, frozen=True):
    """A message as it came: opened only when it is wanted."""

    envelope: Envelope
    data: bytes
    arrived_s: float


class TopicWriter:
    """Publishes one topic and answers late readers with the last message."""

    def __init__(self, connection: Connection, topic: Topic[Any]) -> None:
        session = connection.session
        every = isinstance(topic.policy, Every)
        # What is kept last may be dropped under way as well: the next one comes. Of the others none may be.
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
        """Send to all readers; from any thread."""
        with self._lock:
            codec.encode_into(message, self._buffer)
            payload, envelope = zenoh.ZBytes(self._buffer), seal(self._schema)
            self._last = (payload, envelope)
            self._publisher.put(payload, attachment=envelope)

    def _answer(self, query: zenoh.Query) -> None:
        last = self._last
        if last is not None:
            query.reply(query.key_expr, last[0], attachment=last[1])
        query.drop()


class TopicReader(Generic[T]):
    """Reads one topic for all readers of this process.

    Zenoh keeps the newest messages by itself, without Python: neither a busy loop nor a thread that holds the
    interpreter delays the network or makes it pile up. A thread of the reader's hands them to the loop; a loop that
    was busy fetches them itself. Decoding is the loop's, and only of what is still wanted by then.
    """

    def __init__(self, connection: Connection, topic: Topic[T]) -> None:
        self._connection = connection
        self._topic = topic
        self._loop = connection.loop
        self._every = isinstance(topic.policy, Every)
        depth = topic.policy.depth if isinstance(topic.policy, Every) else 1
        self._schema = fingerprint(topic.type)
        self._limit = codec.largest_bytes(topic.type)
        self._box: deque[Letter] = deque(maxlen=depth)
        self._newest: Letter | None = None
        self._value: T | None = None
        self._mailboxes: list[weakref.ref[Mailbox[T]]] = []
        self._waiting_for_last: list[weakref.ref[Mailbox[T]]] = []
        session = connection.session
        ring = zenoh.handlers.RingChannel(max(depth, BURST) if self._every else 1)
        self._subscriber = session.declare_subscriber(f"topic/{topic.name}", ring)
        self._pump = threading.Thread(target=self._hand_over, name=f"reads {topic.name}", daemon=True)
        with threads_urgent():  # it holds the interpreter's lock, for which heartbeats and orders would wait
            self._pump.start()
        self._token = session.liveliness().declare_token(f"reader/{topic.name}/{self._schema.hex()}/{session.zid()}")
        self._writers = watch_schemas(connection, "writer", topic.name, self._schema, self._ask_for_last)

    def latest(self) -> Latest[T]:
        """The newest message and its age."""
        self._refresh()
        if self._value is None or self._newest is None:
            return Latest(None, float("inf"))
        return Latest(self._value, self._loop.time() - self._sent_s(self._newest))

    def open_mailbox(self, *, with_last: bool) -> Mailbox[T]:
        """A mailbox for messages from now on, after the last one where that is wanted."""
        self._refresh()
        mailbox: Mailbox[T] = Mailbox(self._topic.policy, self._refresh)
        if with_last and self._value is not None and self._newest is not None:
            mailbox.put(self._value, self._sent_s(self._newest))
        elif with_last:
            self._waiting_for_last.append(weakref.ref(mailbox))
        self._mailboxes.append(weakref.ref(mailbox))
        return mailbox

    def close(self) -> None:
        """Streams end."""
        for reference in self._mailboxes:
            mailbox = reference()
            if mailbox is not None:
                mailbox.close()

    def join(self, patience_s: float) -> bool:
        """Wait for the thread, which ends with the session; whether it has."""
        self._pump.join(patience_s)
        return not self._pump.is_alive()

    def _hand_over(self) -> None:
        for sample in self._subscriber.handler:
            letter = self._letter(sample)
            if letter is not None:
                self._box.append(letter)
                self._connection.loop.call_soon_threadsafe(self._drain)

    def _letter(self, sample: zenoh.Sample) -> Letter | None:
        try:
            envelope, data = unpacked(sample, self._schema, self._limit)
        except CommunicationError as error:
            self._connection.refusals.note(self._topic.name, error)
            return None
        return Letter(envelope, data, self._loop.time())

    def _drain(self) -> None:
        while self._box:
            self._take(self._box.popleft())

    def _refresh(self) -> None:
        """Take what has arrived; of states also what the thread has had no turn for yet, which is newer."""
        self._drain()
        if self._every:
            return
        try:
            sample = self._subscriber.handler.try_recv()
        except zenoh.ZError:  # the session has been closed
            return
        letter = None if sample is None else self._letter(sample)
        if letter is not None:
            self._take(letter)

    def _take(self, letter: Letter) -> None:
        if not self._every and self._newest is not None and letter.envelope.not_after(self._newest.envelope):
            return  # the loop has been faster than the thread that still held it
        message = self._decode(letter)
        if message is not None:
            self._waiting_for_last.clear()
            self._deliver(message, letter, self._mailboxes)

    def _ask_for_last(self) -> None:
        if self._connection.session.is_closed():
            return
        known = self._newest

        def on_reply(reply: zenoh.Reply) -> None:
            letter = None if reply.ok is None else self._letter(reply.ok)
            if letter is not None:
                self._connection.loop.call_soon_threadsafe(self._take_last, letter, known)

        self._connection.session.get(f"last/{self._topic.name}", on_reply, timeout=ASK_TIMEOUT_S)

    def _take_last(self, letter: Letter, known: Letter | None) -> None:
        if self._newest is not known:
            return  # a newer one has come meanwhile
        message = self._decode(letter)
        if message is not None:
            self._deliver(message, letter, self._waiting_for_last)
            self._waiting_for_last.clear()

    def _decode(self, letter: Letter) -> T | None:
        try:
            return codec.decode(letter.data, self._topic.type)
        except CommunicationError as error:
            self._connection.refusals.note(self._topic.name, error)
            return None

    def _deliver(self, message: T, letter: Letter, references: list[weakref.ref[Mailbox[T]]]) -> None:
        self._value, self._newest = message, letter
        sent_s = self._sent_s(letter)
        gone = False
        for reference in references:
            mailbox = reference()
            if mailbox is None:
                gone = True
            else:
                mailbox.put(message, sent_s)
        if gone:
            references[:] = [reference for reference in references if reference() is not None]

    @staticmethod
    def _sent_s(letter: Letter) -> float:
        return letter.envelope.sent_s(letter.arrived_s)


def unpacked(sample: zenoh.Sample, schema: bytes, limit: int) -> tuple[Envelope, bytes]:
    """Envelope and bytes of a message. Raises `CommunicationError`: another version's, or too long."""
    attachment, payload = sample.attachment, sample.payload
    envelope = opened(None if attachment is None else attachment.to_bytes(), schema)
    if len(payload) > limit:
        raise CommunicationError(f"a message of {len(payload)} bytes refused; the longest allowed has {limit}")
    return envelope, payload.to_bytes()


def watch_schemas(
    connection: Connection, who: str, topic: str, ours: bytes, came: Callable[[], None] | None = None
) -> "zenoh.Subscriber[None]":
    """Note whoever comes to the topic's other end with another schema; tell `came`, on the loop, of the others."""

    def on_token(sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        theirs = str(sample.key_expr).split("/")[-2]
        if theirs != ours.hex():
            connection.loop.call_soon_threadsafe(connection.refusals.note, topic, mismatch(theirs, ours))
        elif came is not None:
            connection.loop.call_soon_threadsafe(came)

    return connection.session.liveliness().declare_subscriber(f"{who}/{topic}/*/*", on_token, history=True)
