"""Algorithm 2 for one component: check a call against the skill's contract, run it at most once, and answer it."""

import asyncio
import inspect
import logging
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from dlokit.communication.component import Component
from dlokit.communication.log_rate import LogRate
from dlokit.communication.skill import SCHEMA_MISMATCH, Condition, ReportingSkill, Skill, SkillCall
from dlokit.communication.timing.clock import Clock
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.communication.wire.envelope import mismatch
from dlokit.errors import CommunicationError, SkillFailure, SkillRejected
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, Succeeded, TimedOut

log = logging.getLogger(__name__)

ANSWERS_KEPT = 64
"""Number of stored answers; the oldest are deleted first. Calls are repeated only while their caller waits."""
LARGEST_TOTAL_BYTES = 1_000_000
"""Largest total size of the stored answers [bytes]; an answer larger than this is not stored."""
CALLS_KNOWN = 4096
"""Number of call ids that are remembered, with or without their answers; more than `ANSWERS_KEPT`."""

_CANCELLED = codec.encode(Cancelled())
_FORGOTTEN = codec.encode(
    Failed(reason="answer_forgotten", detail="the call has already run and does not run again; its outcome was deleted")
)

_Check = Callable[[str, dict[str, Any]], str | None]
"""Takes the caller's name and the arguments; returns a description of the problem, or None."""


@dataclass(frozen=True)
class _Served:
    """A skill as the component implements it, with the conditions of its contract that can be checked."""

    skill: Skill[..., Any]
    run: Callable[..., Any]
    before: tuple[tuple[Condition, _Check], ...]
    after: tuple[tuple[Condition, _Check], ...]


class Dispatcher:
    """Algorithm 2 for one component."""

    def __init__(self, component: Component, clock: Clock) -> None:
        self._address = component.address
        self._clock = clock
        self._skills = {skill.name: _served(component, skill, method) for skill, method in component.skills().items()}
        self._running: dict[str, asyncio.Future[bytes]] = {}
        self._stored: OrderedDict[str, bytes] = OrderedDict()
        """Call id → stored answer, the oldest first."""
        self._stored_bytes = 0
        self._known: OrderedDict[str, None] = OrderedDict()
        """Ids of the newest completed calls, the oldest first."""
        self._rate = LogRate()
        self._held: dict[str, str] = {}
        """Exclusive resource → name of the skill that uses it."""

    async def __call__(self, call: SkillCall, report: Report) -> bytes:
        """Answer a call; repeated deliveries of the same call run the skill once."""
        if (stored := self._stored.get(call.call_id)) is not None:
            return stored
        if call.call_id in self._known:
            return _FORGOTTEN
        if (running := self._running.get(call.call_id)) is not None:
            return await asyncio.shield(running)
        answered = self._running[call.call_id] = asyncio.get_running_loop().create_future()
        answer = _CANCELLED
        try:
            outcome = await self._run(call, report)
            try:
                answer = codec.encode(outcome)
            except CommunicationError as error:
                answer = codec.encode(Failed(reason="result_not_encodable", detail=str(error)))
        finally:
            answered.set_result(answer)
            del self._running[call.call_id]
            self._keep(call.call_id, answer)
        return answer

    def _keep(self, call_id: str, answer: bytes) -> None:
        """Remember a completed call, and store its answer for repeated deliveries, within the bounds."""
        self._known[call_id] = None
        if len(self._known) > CALLS_KNOWN:
            self._known.popitem(last=False)
        if len(answer) <= LARGEST_TOTAL_BYTES:
            self._stored[call_id] = answer
            self._stored_bytes += len(answer)
        while len(self._stored) > ANSWERS_KEPT or self._stored_bytes > LARGEST_TOTAL_BYTES:
            _, oldest = self._stored.popitem(last=False)
            self._stored_bytes -= len(oldest)

    async def _run(self, call: SkillCall, report: Report) -> Outcome[Any]:
        """Check the call, its arguments and the preconditions; run the skill; check the postconditions."""
        if call.component != self._address:
            return Rejected(
                reason="wrong_component", detail=f"the call is for {call.component}; this is {self._address}"
            )
        served = self._skills.get(call.skill)
        if served is None:
            return Rejected(reason="unknown_skill", detail=f"{call.skill}; {call.component} has {sorted(self._skills)}")
        skill, run = served.skill, served.run
        if call.schema != skill.schema:
            error = mismatch(call.schema.hex(), skill.schema)
            if number := self._rate.due(skill.key):
                log.error("calls of %s rejected: %d, the last from %s: %s", skill.key, number, call.caller, error)
            return Rejected(reason=SCHEMA_MISMATCH, detail=str(error))
        try:
            arguments = msgspec.structs.asdict(codec.decode(call.arguments, skill.arguments_type))
        except CommunicationError as error:
            detail = f"arguments of {skill.key} do not fit: {error}; expected {skill.call_signature}"
            return Rejected(reason="bad_arguments", detail=detail)
        for condition, check in served.before:
            if (detail := check(call.caller, arguments)) is not None:
                return Rejected(reason=condition.reason, detail=detail)
        if skill.exclusive and skill.exclusive in self._held:
            holder = self._held[skill.exclusive]
            return Rejected(reason="busy", detail=f"{holder} is running; wait until it ends, or stop it")
        if isinstance(skill, ReportingSkill):
            run = partial(run, lambda progress: report(codec.encode(progress)))
        if skill.exclusive:
            self._held[skill.exclusive] = skill.name
        try:
            outcome = await _execute(skill, run, arguments, self._clock)
        finally:
            self._held.pop(skill.exclusive, None)
        if isinstance(outcome, Succeeded):
            for condition, check in served.after:
                if (detail := check(call.caller, arguments)) is not None:
                    return Failed(reason=condition.reason, detail=detail)
        return outcome


def _served(component: Component, skill: Skill[..., Any], method: str) -> _Served:
    """A skill of a component, with those conditions that name a check."""
    checks = {
        condition: _check_of(getattr(component, checking)) for condition, checking in component.conditions().items()
    }

    def checked(required: tuple[Condition, ...]) -> tuple[tuple[Condition, _Check], ...]:
        found: list[tuple[Condition, _Check]] = []
        for condition in required:
            if condition.of is not None:
                found.append((condition, lambda caller, arguments, condition=condition: condition.violation(arguments)))
            if condition in checks:
                found.append((condition, checks[condition]))
        return tuple(found)

    return _Served(
        skill=skill,
        run=getattr(component, method),
        before=checked((*skill.preconditions, *skill.keeps)),
        after=checked((*skill.keeps, *skill.postconditions)),
    )


def _check_of(method: Callable[..., str | None]) -> _Check:
    """Adapt a component's method that checks a condition and takes some of a skill's arguments, to take all of them."""
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
