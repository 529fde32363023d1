"""Algorithm 2 for one component: check a call against the skill's contract, run it at most once, and answer it."""

import asyncio
import inspect
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

from dlokit.communication.component import Component
from dlokit.communication.log_rate import LogRate
from dlokit.communication.skill import SCHEMA_MISMATCH, Condition, ReportingSkill, Skill, SkillCall
from dlokit.communication.timing.clock import Clock
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.communication.wire.envelope import mismatch
from dlokit.errors import CommunicationError, SkillFailure, SkillRejected
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, Succeeded, TimedOut

ANSWERS_KEPT = 64
"""Number of stored answers; the oldest are deleted first. A call is repeated, if ever, while its caller waits."""
LARGEST_TOTAL_BYTES = 1_000_000
"""Largest total size of the stored answers [bytes]; an answer larger than this is not stored."""
CALLS_KNOWN = 4096
"""Number of call ids that are remembered, with or without their answers."""


class Answers:
    """Encoded outcomes of the calls to one component, by call id."""

    def __init__(self, forgotten: bytes, cancelled: bytes) -> None:
        """`forgotten` is the answer for a call whose outcome was deleted, `cancelled` for a call that was cancelled."""
        self._forgotten = forgotten
        self._cancelled = cancelled
        self._known: OrderedDict[str, None] = OrderedDict()
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._total = 0
        self._running: dict[str, asyncio.Future[bytes]] = {}

    async def once(self, call_id: str, run: Callable[[], Awaitable[bytes]]) -> bytes:
        """Answer a call: run it, wait for the same call that already runs, or return the stored answer."""
        if call_id in self._kept:
            return self._kept[call_id]
        if call_id in self._known:
            return self._forgotten
        if call_id in self._running:
            return await asyncio.shield(self._running[call_id])
        answered = self._running[call_id] = asyncio.get_running_loop().create_future()
        answer = self._cancelled
        try:
            answer = await run()
        finally:
            answered.set_result(answer)
            del self._running[call_id]
            self._keep(call_id, answer)
        return answer

    def _keep(self, call_id: str, answer: bytes) -> None:
        self._known[call_id] = None
        if len(answer) <= LARGEST_TOTAL_BYTES:
            self._kept[call_id] = answer
            self._total += len(answer)
        while len(self._known) > CALLS_KNOWN:
            self._known.popitem(last=False)
        while len(self._kept) > ANSWERS_KEPT or self._total > LARGEST_TOTAL_BYTES:
            self._total -= len(self._kept.popitem(last=False)[1])


log = logging.getLogger(__name__)

_FORGOTTEN = Failed(
    reason="answer_forgotten", detail="the call has already run and does not run again; its outcome was deleted"
)


class Dispatcher:
    """Algorithm 2 for one component."""

    def __init__(self, component: Component, clock: Clock) -> None:
        self._component = component
        self._clock = clock
        self._skills: dict[str, tuple[Skill[..., Any], str]] = {
            skill.name: (skill, method) for skill, method in component.skills().items()
        }
        self._conditions = {
            condition: _checking(getattr(component, method)) for condition, method in component.conditions().items()
        }
        self._answers = Answers(forgotten=codec.encode(_FORGOTTEN), cancelled=codec.encode(Cancelled()))
        self._rate = LogRate()
        self._held: dict[str, str] = {}
        """Exclusive resource → name of the skill that uses it."""

    async def __call__(self, request: bytes, report: Report) -> bytes:
        """Answer a call; repeated deliveries of the same call run the skill once."""
        try:
            call = codec.decode(request, SkillCall)
        except CommunicationError as error:
            return codec.encode(Rejected(reason="malformed_call", detail=str(error)))
        return await self._answers.once(call.call_id, lambda: self._answer(call, report))

    async def _answer(self, call: SkillCall, report: Report) -> bytes:
        outcome = await self._run(call, report)
        try:
            return codec.encode(outcome)
        except CommunicationError as error:
            return codec.encode(Failed(reason="result_not_encodable", detail=str(error)))

    async def _run(self, call: SkillCall, report: Report) -> Outcome[Any]:
        if call.component != self._component.address:
            return Rejected(
                reason="wrong_component", detail=f"the call is for {call.component}; this is {self._component.address}"
            )
        if call.skill not in self._skills:
            return Rejected(reason="unknown_skill", detail=f"{call.skill}; {call.component} has {sorted(self._skills)}")
        skill, method = self._skills[call.skill]
        if call.schema != skill.schema:
            error = mismatch(call.schema.hex(), skill.schema)
            if number := self._rate.due(skill.key):
                log.error("calls of %s rejected: %d, the last from %s: %s", skill.key, number, call.caller, error)
            return Rejected(reason=SCHEMA_MISMATCH, detail=str(error))
        try:
            arguments = skill.decode_arguments(call.arguments)
        except CommunicationError as error:
            return Rejected(reason="bad_arguments", detail=str(error))
        wrong = self._first_violation((*skill.preconditions, *skill.keeps), call.caller, arguments)
        if wrong is not None:
            return Rejected(reason=wrong[0], detail=wrong[1])
        holder = self._held.get(skill.exclusive) if skill.exclusive else None
        if holder is not None:
            return Rejected(reason="busy", detail=f"{holder} is running; wait until it ends, or stop it")
        run = getattr(self._component, method)
        if isinstance(skill, ReportingSkill):
            run = partial(run, lambda progress: report(codec.encode(progress)))
        if skill.exclusive:
            self._held[skill.exclusive] = skill.name
        try:
            outcome = await _execute(skill, run, arguments, self._clock)
        finally:
            self._held.pop(skill.exclusive, None)
        if isinstance(outcome, Succeeded):
            wrong = self._first_violation((*skill.keeps, *skill.postconditions), call.caller, arguments)
            if wrong is not None:
                return Failed(reason=wrong[0], detail=wrong[1])
        return outcome

    def _first_violation(
        self, required: tuple[Condition, ...], caller: str, arguments: dict[str, Any]
    ) -> tuple[str, str] | None:
        """Reason and detail of the first condition that does not hold; None if all hold."""
        for condition in required:
            detail = condition.violation(arguments)
            check = self._conditions.get(condition)
            if detail is None and check is not None:
                detail = check(caller, arguments)
            if detail is not None:
                return condition.reason, detail
        return None


def _checking(method: Callable[..., str | None]) -> Callable[[str, dict[str, Any]], str | None]:
    """A component's method that checks a condition, for all arguments of a skill, of which it takes some."""
    names = tuple(inspect.signature(method).parameters)[1:]
    return lambda caller, arguments: method(caller, **{name: arguments[name] for name in names})


async def _execute(skill: Skill[..., Any], method: Any, arguments: dict[str, Any], clock: Clock) -> Outcome[Any]:
    limit: asyncio.Timeout | None = None
    try:
        async with clock.timeout(skill.timeout_s) as limit:
            return Succeeded(result=await method(**arguments))
    except SkillRejected as error:
        return Rejected(reason=error.reason, detail=error.detail)
    except SkillFailure as error:
        return Failed(reason=error.reason, detail=error.detail)
    except TimeoutError as error:
        if limit is not None and limit.expired():
            return TimedOut(timeout_s=skill.timeout_s)
        return Failed(reason="timeout_inside", detail=str(error))
    except asyncio.CancelledError:
        current = asyncio.current_task()
        if current is not None and current.cancelling():
            raise
        return Cancelled()
    except Exception as error:  # an error in a skill is an outcome, never a crash (Algorithm 2)
        log.exception("%s raised", skill.key)
        return Failed(reason="error", detail=f"{type(error).__name__}: {error}")
