"""A component's window to the rest of the system: its messages, calls, clock, and where its heavy work goes."""

import logging
from collections.abc import Callable
from typing import Any, ParamSpec, Protocol, TypeVar

import msgspec

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.timing.clock import Clock
from dlokit.communication.topic import Topic
from dlokit.communication.transport import Latest, Liveness, Stream, Transport
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome

P = ParamSpec("P")
R = TypeVar("R")


class Compute(Protocol):
    """Runs a pure, picklable function of ours somewhere."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``."""
        ...


class InlineCompute:
    """Here and now; the virtual clock stands still meanwhile."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``."""
        return function(*args, **kwargs)


log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)


Q = TypeVar("Q")


class Port:
    """What a container gives a component. It holds the component to what it declares."""

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
        """`owner` may publish `publishes` and read `subscribes` (None: everything), whosever they are.

        What it publishes is its own `instance`'s, unless it says whose it is.
        """
        self._transport = transport
        self.clock = clock
        self.compute = compute
        """Runs heavy, pure work where it does not stop the loop."""
        self._owner = owner
        self._instance = instance
        self._publishes = {topic.row for topic in publishes}
        self._subscribes = None if subscribes is None else {topic.row for topic in subscribes}
        self._sequence: dict[str, int] = {}

    def publish(self, topic: Topic[T], message: T) -> None:
        """Send a message, numbered on its topic. Only topics that the component declares are allowed."""
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
        """Messages of a topic from now on; it says how old the one read last is."""
        self._check_read(topic)
        return self._transport.stream(topic)

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Ask another component for a skill."""
        return await self._transport.call(skill, *args, **kwargs)

    async def call_reported(
        self, skill: ReportingSkill[P, R, Q], told: Callable[[Q], None], *args: P.args, **kwargs: P.kwargs
    ) -> Outcome[R]:
        """Ask another component for a skill, and hear of its progress meanwhile."""
        return await self._transport.call_reported(skill, told, *args, **kwargs)

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """Ask another component for a skill and return at once; live, from any thread."""
        self._transport.send(skill, *args, **kwargs)

    def tap(self, topic: Topic[T], listener: Callable[[T], None]) -> None:
        """Hand every message of a topic to `listener`; live, on a thread of the network's, past the loop."""
        self._check_read(topic)

        def hear(data: bytes) -> None:
            try:
                message = codec.decode(data, topic.type)
            except CommunicationError as error:
                log.warning("a message on %s was dropped: %s", topic.name, error)
                return
            listener(message)

        self._transport.tap(topic, hear)

    def alive(self, component: str) -> Liveness:
        """Whether another component is there."""
        return self._transport.alive(component)

    def _check_read(self, topic: Topic[Any]) -> None:
        if self._subscribes is not None and topic.row not in self._subscribes:
            raise CommunicationError(
                f"{self._owner} may not read {topic.name}: it declares {sorted(self._subscribes)}; "
                f"add the topic to its `reads`"
            )
