"""The bus within one process. Messages pass through the codec, so that it behaves like a network bus."""

import asyncio
import contextlib
import itertools
from collections import defaultdict
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from dlokit.communication.calls import CallListener, SkillCaller
from dlokit.communication.skill import Skill, SkillCall
from dlokit.communication.topic import Topic
from dlokit.communication.transport import CallHandler, Latest, Liveness, Mailbox, Report
from dlokit.communication.wire import codec
from dlokit.types.message import Message
from dlokit.types.outcome import Unreachable

T = TypeVar("T", bound=Message)
P = ParamSpec("P")


class MemoryTransport(SkillCaller):
    """Publish, read and call within one event loop; one instance is one bus."""

    def __init__(
        self, tap: Callable[[Topic[Any], Message], None] | None = None, call_log: CallListener | None = None
    ) -> None:
        """`tap` gets every message as the readers get it. The only caller is this process."""
        super().__init__("memory", call_log)
        self._tap = tap
        self._taps: defaultdict[str, list[Callable[[bytes], None]]] = defaultdict(list)
        self._sent: set[asyncio.Task[Any]] = set()
        self._latest: dict[str, tuple[Any, float]] = {}
        self._mailboxes: defaultdict[str, WeakKeyDictionary[Mailbox[Any], None]] = defaultdict(WeakKeyDictionary)
        """Mailboxes of the readers that are not garbage-collected, in the order of their subscription."""
        self._handlers: dict[str, CallHandler] = {}
        self._served = asyncio.Event()
        self._closed = False

    def publish(self, topic: Topic[T], message: T) -> None:
        """Deliver the same decoded, read-only copy to all readers."""
        data = codec.encode(message)
        for listener in self._taps[topic.name]:
            listener(data)
        copy = codec.decode(data, topic.type)
        now_s = asyncio.get_running_loop().time()
        self._latest[topic.name] = (copy, now_s)
        if self._tap is not None:
            self._tap(topic, copy)
        for mailbox in self._mailboxes[topic.name]:
            mailbox.put(copy, now_s)

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """The newest message, also to a reader that joined after it was published."""
        if topic.name not in self._latest:
            return Latest(None, float("inf"))
        value, arrived = self._latest[topic.name]
        return Latest(value, asyncio.get_running_loop().time() - arrived)

    def stream(self, topic: Topic[T], *, with_last: bool = False) -> Mailbox[T]:
        """Messages from now on; with `with_last`, the last published message first."""
        mailbox: Mailbox[T] = Mailbox(topic.policy)
        if with_last and topic.name in self._latest:
            mailbox.put(*self._latest[topic.name])
        if self._closed:
            mailbox.close()
        self._mailboxes[topic.name][mailbox] = None
        return mailbox

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """Call without waiting for the outcome; only on the loop's thread."""
        task = asyncio.get_running_loop().create_task(self.call(skill, *args, **kwargs), name=f"sent {skill.key}")
        self._sent.add(task)
        task.add_done_callback(self._sent.discard)

    def tap(self, topic: Topic[Any], listener: Callable[[bytes], None]) -> None:
        """Pass every message, still encoded, to `listener` before the readers get it."""
        self._taps[topic.name].append(listener)

    async def _deliver(self, skill: Skill[..., Any], call: SkillCall, report: Report) -> bytes | Unreachable:
        handler = self._handlers.get(call.component)
        return Unreachable(component=call.component) if handler is None else await handler(call, report)

    def alive(self, component: str) -> Liveness:
        """A component is alive while it is served."""
        return Liveness(component in self._handlers)

    def serving(self, component: str) -> int:
        """Number of processes that serve a component: at most one."""
        return int(component in self._handlers)

    async def wait_for(self, component: str, timeout_s: float) -> bool:
        """Wait up to `timeout_s` until a component is served; returns whether it is."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while component not in self._handlers:
                    await self._served.wait()
        return component in self._handlers

    def serve(self, component: str, handler: CallHandler) -> None:
        """Answer calls to `component`."""
        self._handlers[component] = handler
        self._served.set()  # wakes the present waiters only
        self._served.clear()

    async def withdraw(self, component: str) -> None:
        """Stop answering calls; running calls belong to their callers' tasks."""
        self._handlers.pop(component, None)

    async def close(self) -> None:
        """End all streams and remove all handlers."""
        self._closed = True
        self._handlers.clear()
        for mailbox in itertools.chain.from_iterable(self._mailboxes.values()):
            mailbox.close()
