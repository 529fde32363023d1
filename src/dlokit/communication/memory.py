"""The bus within one process. Messages pass through the codec, so that it behaves as a real one."""

import asyncio
import itertools
from collections import defaultdict
from typing import Any, ParamSpec, TypeVar

from dlokit.communication import codec
from dlokit.communication.mailbox import Mailbox
from dlokit.communication.skill import Skill, SkillCall
from dlokit.communication.topic import Topic
from dlokit.communication.transport import CallHandler, Known, Latest, Liveness
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome, Unreachable

T = TypeVar("T", bound=Message)
P = ParamSpec("P")
R = TypeVar("R")


class MemoryTransport:
    """Publish, read and call within one event loop; one instance is one bus."""

    def __init__(self) -> None:
        self._latest: dict[str, tuple[Any, float]] = {}
        self._mailboxes: defaultdict[str, list[Mailbox[Any]]] = defaultdict(list)
        self._handlers: dict[str, CallHandler] = {}
        self._call_ids = itertools.count(1)

    def publish(self, topic: Topic[T], message: T) -> None:
        """Hand everybody the same decoded, read-only copy."""
        copy = codec.decode(codec.encode(message), topic.type)
        self._latest[topic.name] = (copy, asyncio.get_running_loop().time())
        for mailbox in self._mailboxes[topic.name]:
            mailbox.put(copy)

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """The newest message, whoever came when."""
        if topic.name not in self._latest:
            return Latest(None, float("inf"))
        value, arrived = self._latest[topic.name]
        return Latest(value, asyncio.get_running_loop().time() - arrived)

    def stream(self, topic: Topic[T]) -> Mailbox[T]:
        """Messages from now on."""
        mailbox: Mailbox[T] = Mailbox(topic.policy)
        self._mailboxes[topic.name].append(mailbox)
        return mailbox

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Algorithm 1; a cancelled caller cancels the skill."""
        call = SkillCall(
            component=skill.component,
            skill=skill.name,
            arguments=skill.encode_arguments(*args, **kwargs),
            call_id=f"memory-{next(self._call_ids)}",
            caller="memory",
        )
        handler = self._handlers.get(skill.component)
        if handler is None:
            return Unreachable(component=skill.component)
        return skill.decode_outcome(await handler(codec.encode(call)))

    def alive(self, component: str) -> Liveness:
        """A component is alive while it is served."""
        return Known(component in self._handlers)

    def serve(self, component: str, handler: CallHandler) -> None:
        """Answer calls to `component`."""
        self._handlers[component] = handler

    async def close(self) -> None:
        """End all streams, forget all handlers."""
        self._handlers.clear()
        for mailbox in itertools.chain.from_iterable(self._mailboxes.values()):
            mailbox.close()
