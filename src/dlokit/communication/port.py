"""A component's port: its access to messages, calls, the clock, and computation outside the event loop."""

import logging
from collections.abc import Callable
from typing import Any, ParamSpec, Protocol, TypeVar

import msgspec

from dlokit.communication.log_rate import LogRate
from dlokit.communication.timing.clock import Clock
from dlokit.communication.topic import Topic
from dlokit.communication.transport import Latest, Stream, Transport
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.types.message import Message

P = ParamSpec("P")
R = TypeVar("R")


class Compute(Protocol):
    """Runs a pure, picklable function of dlokit, inline or in another process."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``."""
        ...


class InlineCompute:
    """Computes on the event loop; the virtual clock does not advance meanwhile."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``."""
        return function(*args, **kwargs)


log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)


Q = TypeVar("Q")


class Port:
    """A component's access to the bus, which allows only the topics that the component declares."""

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        compute: Compute,
        *,
        owner: str,
        publishes: tuple[Topic[Any], ...],
        subscribes: tuple[Topic[Any], ...] | None = None,
        instance: str = "",
    ) -> None:
        """`owner` may publish the topics `publishes` and read `subscribes` (None: all), of every instance.

        A topic without an instance is published as the topic of `instance`.
        """
        self._transport = transport
        self.clock = clock
        self.compute = compute
        """Runs long pure computations where they do not block the loop."""
        self._owner = owner
        self._instance = instance
        self._publishes = {topic.row for topic in publishes}
        self._subscribes = None if subscribes is None else {topic.row for topic in subscribes}
        self._sequence: dict[str, int] = {}
        self.call = transport.call
        """Calls a skill of another component, as `Transport.call`."""
        self.call_reported = transport.call_reported
        """The same for a skill that reports its progress."""
        self.send = transport.send
        """Calls a skill of another component and returns at once; live, any thread may do so."""
        self.alive = transport.alive
        """Whether another component can be called."""

    def publish(self, topic: Topic[T], message: T) -> None:
        """Publish a message with its sequence number. Raises `CommunicationError` for an undeclared topic."""
        if topic.row not in self._publishes:
            raise CommunicationError(
                f"{self._owner} may not publish {topic.name}: it declares {sorted(self._publishes)}; "
                f"add the topic to its `publishes`"
            )
        if self._instance and not topic.instance:
            topic = topic.at(self._instance)
        number = self._sequence.get(topic.name, 0) + 1
        self._sequence[topic.name] = number
        self._transport.publish(topic, msgspec.structs.replace(message, seq=number))

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """The newest message of a topic and its age."""
        self._check_read(topic)
        return self._transport.latest(topic)

    def stream(self, topic: Topic[T]) -> Stream[T]:
        """Messages of a topic from now on, with the age of the last read one."""
        self._check_read(topic)
        return self._transport.stream(topic)

    def tap(self, topic: Topic[T], listener: Callable[[T], None]) -> None:
        """Pass every message of a topic to `listener`; live, on a network thread, independent of the loop."""
        self._check_read(topic)
        rate = LogRate()

        def decode_and_pass(data: bytes) -> None:
            try:
                message = codec.decode(data, topic.type)
            except CommunicationError as error:
                if number := rate.due(topic.name):
                    log.warning("messages on %s dropped: %d, the last: %s", topic.name, number, error)
                return
            listener(message)

        self._transport.tap(topic, decode_and_pass)

    def _check_read(self, topic: Topic[Any]) -> None:
        if self._subscribes is not None and topic.row not in self._subscribes:
            raise CommunicationError(
                f"{self._owner} may not read {topic.name}: it declares {sorted(self._subscribes)}; "
                f"add the topic to its `reads`"
            )
