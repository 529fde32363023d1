"""Topics over zenoh: writers that remember their last message, readers that never fall behind.

A message published before a reader was there would be lost to it; so each writer answers for its last
one, and announces itself by a liveliness token. A reader asks whoever it sees announced.
"""

import asyncio
import logging
import threading
import weakref
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import zenoh

from dlokit.communication import codec
from dlokit.communication.mailbox import Mailbox
from dlokit.communication.topic import Every, Topic
from dlokit.communication.transport import Latest
from dlokit.errors import CommunicationError
from dlokit.types.message import Message

log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

ASK_TIMEOUT_S = 5.0
"""Longest wait for a writer's last message; it comes within a millisecond, or its process hangs."""


class TopicWriter:
    """Publishes one topic and answers late readers with the last message."""

    def __init__(self, session: zenoh.Session, topic: Topic[Any]) -> None:
        every = isinstance(topic.policy, Every)
        # What is kept last may be dropped under way as well: the next one comes. Of the others none may be.
        control = zenoh.CongestionControl.BLOCK if every else zenoh.CongestionControl.DROP
        self._publisher = session.declare_publisher(f"topic/{topic.name}", congestion_control=control)
        self._last = b""
        self._answers = session.declare_queryable(f"last/{topic.name}", self._answer)
        self._token = session.liveliness().declare_token(f"writer/{topic.name}/{session.zid()}")

    def put(self, data: bytes) -> None:
        """Send to all readers."""
        self._last = data
        self._publisher.put(data)

    def _answer(self, query: zenoh.Query) -> None:
        if self._last:
            query.reply(query.key_expr, self._last)
        query.drop()


class TopicReader(Generic[T]):
    """Reads one topic for all readers of this process.

    Zenoh delivers on threads of its own. They only drop bytes in a bounded box and wake the loop;
    decoding is the loop's, and only of what is still wanted by then.
    """

    def __init__(self, session: zenoh.Session, topic: Topic[T], loop: asyncio.AbstractEventLoop) -> None:
        self._session = session
        self._topic = topic
        self._loop = loop
        self._lock = threading.Lock()
        self._box: deque[bytes] = deque(maxlen=topic.policy.depth if isinstance(topic.policy, Every) else 1)
        self._woken = False
        self._received = 0
        self._value: T | None = None
        self._arrived_s = 0.0
        self._mailboxes: list[weakref.ref[Mailbox[T]]] = []
        self._waiting_for_last: list[weakref.ref[Mailbox[T]]] = []
        self._subscriber = session.declare_subscriber(f"topic/{topic.name}", self._on_sample)
        self._writers = session.liveliness().declare_subscriber(f"writer/{topic.name}/*", self._on_writer, history=True)

    def latest(self) -> Latest[T]:
        """The newest message and its age."""
        if self._value is None:
            return Latest(None, float("inf"))
        return Latest(self._value, self._loop.time() - self._arrived_s)

    def open_mailbox(self, *, with_last: bool) -> Mailbox[T]:
        """A mailbox for messages from now on, after the last one where that is wanted."""
        mailbox: Mailbox[T] = Mailbox(self._topic.policy)
        if with_last and self._value is not None:
            mailbox.put(self._value)
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

    def _on_sample(self, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes()
        with self._lock:
            self._box.append(data)
            if self._woken:
                return
            self._woken = True
        call_on_loop(self._loop, self._drain)

    def _drain(self) -> None:
        with self._lock:
            waiting = list(self._box)
            self._box.clear()
            self._woken = False
        for data in waiting:
            self._received += 1
            message = self._decode(data)
            if message is not None:
                self._waiting_for_last.clear()
                self._keep(message)
                self._deliver(message, self._mailboxes)

    def _on_writer(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            call_on_loop(self._loop, self._ask_for_last)

    def _ask_for_last(self) -> None:
        if self._session.is_closed():
            return
        received = self._received

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                data = reply.ok.payload.to_bytes()
                call_on_loop(self._loop, lambda: self._take_last(data, received))

        self._session.get(f"last/{self._topic.name}", on_reply, timeout=ASK_TIMEOUT_S)

    def _take_last(self, data: bytes, received: int) -> None:
        if self._received != received:
            return  # a newer one has come meanwhile
        message = self._decode(data)
        if message is not None:
            self._keep(message)
            self._deliver(message, self._waiting_for_last)
            self._waiting_for_last.clear()

    def _decode(self, data: bytes) -> T | None:
        try:
            return codec.decode(data, self._topic.type)
        except CommunicationError as error:
            log.warning("a message on %s was dropped: %s", self._topic.name, error)
            return None

    def _keep(self, message: T) -> None:
        self._value = message
        self._arrived_s = self._loop.time()

    @staticmethod
    def _deliver(message: T, references: list[weakref.ref[Mailbox[T]]]) -> None:
        gone = False
        for reference in references:
            mailbox = reference()
            if mailbox is None:
                gone = True
            else:
                mailbox.put(message)
        if gone:
            references[:] = [reference for reference in references if reference() is not None]


def call_on_loop(loop: asyncio.AbstractEventLoop, function: Callable[[], object]) -> None:
    """Run a function on the loop's thread, from any thread; nothing when the loop has ended."""
    try:
        loop.call_soon_threadsafe(function)
    except RuntimeError:
        log.debug("the loop has ended; %r is dropped", function)
