"""A transport that tells of every skill call that was made through it."""

from collections.abc import Awaitable, Callable
from typing import Any, ParamSpec, TypeVar

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.topic import Topic
from dlokit.communication.transport import CallHandler, Latest, Liveness, Stream, Transport
from dlokit.recording.plain import to_json
from dlokit.types.message import Message
from dlokit.types.outcome import (
    CallBegun,
    CallEnd,
    CallRecord,
    Cancelled,
    Failed,
    Outcome,
    Rejected,
    Succeeded,
    TimedOut,
)

T = TypeVar("T", bound=Message)
P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")

LARGEST_TEXT = 65_536
"""Longer arguments and results are left out [bytes]: the shapes in them are on topics as well."""


class CallLog:
    """Everything is the inner transport's, but that calls are told of when they are made and when they have ended."""

    def __init__(
        self,
        inner: Transport,
        now_ns: Callable[[], int],
        tell: Callable[[CallBegun | CallRecord], None],
        *,
        untold: frozenset[str] = frozenset(),
    ) -> None:
        """`now_ns` is the run's clock; calls to the components `untold` are not told of."""
        self._inner = inner
        self._now_ns = now_ns
        self._tell = tell
        self._untold = untold
        self._begun = 0
        self._ended = 0

    @property
    def identity(self) -> str:
        """As the inner transport."""
        return self._inner.identity

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """As the inner transport; a call that is cancelled is told of too."""
        return await self._logged(self._inner.call(skill, *args, **kwargs), skill, args, kwargs)

    async def call_reported(
        self, skill: ReportingSkill[P, R, Q], told: Callable[[Q], None], *args: P.args, **kwargs: P.kwargs
    ) -> Outcome[R]:
        """As `call`; its progress is not told of."""
        return await self._logged(self._inner.call_reported(skill, told, *args, **kwargs), skill, args, kwargs)

    async def _logged(
        self, call: Awaitable[Outcome[R]], skill: Skill[..., R], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Outcome[R]:
        if skill.component in self._untold:
            return await call
        began_ns, outcome = self._now_ns(), Cancelled()
        self._begun += 1
        number, caller = self._begun, self.identity
        self._tell(CallBegun(stamp_ns=began_ns, seq=number, skill=skill.key, call=number, caller=caller))
        try:
            outcome = await call
        finally:
            self._ended += 1
            end, reason, detail = end_of(outcome)
            record = CallRecord(
                stamp_ns=self._now_ns(),
                seq=self._ended,
                skill=skill.key,
                call=number,
                caller=caller,
                outcome=end,
                reason=reason,
                detail=detail,
                began_ns=began_ns,
                arguments=_arguments(skill, args, kwargs),
                result=_text(outcome.result) if isinstance(outcome, Succeeded) else "",
            )
            self._tell(record)
        return outcome

    def publish(self, topic: Topic[T], message: T) -> None:
        """As the inner transport."""
        self._inner.publish(topic, message)

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """As the inner transport."""
        return self._inner.latest(topic)

    def stream(self, topic: Topic[T], *, with_last: bool = False) -> Stream[T]:
        """As the inner transport."""
        return self._inner.stream(topic, with_last=with_last)

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """As the inner transport; nobody knows how it ends, so it is not told of."""
        self._inner.send(skill, *args, **kwargs)

    def tap(self, topic: Topic[Any], listener: Callable[[bytes], None]) -> None:
        """As the inner transport."""
        self._inner.tap(topic, listener)

    def alive(self, component: str) -> Liveness:
        """As the inner transport."""
        return self._inner.alive(component)

    def serve(self, component: str, handler: CallHandler) -> None:
        """As the inner transport."""
        self._inner.serve(component, handler)

    async def withdraw(self, component: str) -> None:
        """As the inner transport."""
        await self._inner.withdraw(component)

    async def close(self) -> None:
        """As the inner transport."""
        await self._inner.close()


def end_of(outcome: Outcome[Any]) -> tuple[CallEnd, str, str]:
    """How a call ended, its reason, and details for people."""
    match outcome:
        case Succeeded():
            return CallEnd.SUCCEEDED, "", ""
        case Failed(reason=reason, detail=detail):
            return CallEnd.FAILED, reason, detail
        case Rejected(reason=reason, detail=detail):
            return CallEnd.REJECTED, reason, detail
        case Cancelled():
            return CallEnd.CANCELLED, "", ""
        case TimedOut(timeout_s=timeout_s):
            return CallEnd.TIMED_OUT, "", f"after {timeout_s:g} s"
        case _:
            return CallEnd.UNREACHABLE, "", ""


def _arguments(skill: Skill[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> str:
    try:
        named = skill.name_arguments(*args, **kwargs)
    except TypeError:
        return ""  # they do not fit: the outcome says so
    parts = {name: _text(value) for name, value in named.items()}
    text = "{" + ", ".join(f'"{name}": {value or "null"}' for name, value in parts.items()) + "}"
    return text if len(text) <= LARGEST_TEXT else ""


def _text(value: object) -> str:
    data = to_json(value)
    return data.decode() if len(data) <= LARGEST_TEXT else ""
