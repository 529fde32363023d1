"""Skill calls over zenoh: the caller's side (Algorithm 1), and the server that passes calls to the dispatcher.

A call is a query on the key `call/COMPONENT/SKILL`, by which access control distinguishes skills. Its payload is the
encoded arguments, its attachment the caller's schema of the skill and the call's id. The reply is an encoded outcome;
no reply means that no process serves the component. To cancel, the caller sends the call's id to the component's cancel
key. Queries time out early; the caller then queries a longer call again by its id, and the call still runs only once.
"""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import zenoh

from dlokit.communication.skill import SkillCall
from dlokit.communication.timing.urgency import threads_urgent
from dlokit.communication.transport import CallHandler, Report
from dlokit.communication.wire.schema import FINGERPRINT_BYTES

log = logging.getLogger(__name__)

QUERY_TIMEOUT_S = 30.0
"""Time-out of a query [s of machine time]. Until then zenoh keeps about half a kilobyte per query, even an answered one
(measured: 10,000 calls cost 5.3 MB); with the time limits of skills as time-outs, it would keep hours of queries."""

SENT_LIMIT_S = 10.0
"""Time after which zenoh discards a call that was sent without waiting for its answer [s]."""

CALLS_REMEMBERED = 64
"""Number of remembered ids of cancelled calls whose request has not arrived yet."""


OUTCOME, PROGRESS = b"outcome", b"progress"
"""Attachment of a reply: progress or outcome."""


@dataclass
class Call:
    """A call of a skill, seen from its caller. Only `cancel` cancels the skill itself.

    No object here refers to itself: answers hold pictures, which would wait for a garbage collection.
    """

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    call: SkillCall
    report: Report
    """Receives the encoded reports of progress, on the loop."""
    server: Callable[[], str]
    """Id of the process that serves the component. A new process has no record of this call and would run the skill
    again; therefore it is not queried."""
    asked_of: str
    """That id when the call is made."""
    query_s: float = QUERY_TIMEOUT_S
    """Time-out of each query [s]."""
    answered: "asyncio.Future[bytes | None]" = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    """Gets the encoded outcome; None if no process answers."""

    def ask(self) -> None:
        """Ask for the answer, again and again until `answered` is done."""
        try:
            _query(
                self.session,
                self.call,
                # On zenoh's own thread: both only wake the loop, and a thread for each call costs 0.7 ms.
                zenoh.handlers.Callback(self._on_reply, partial(self._on_end, time.monotonic()), indirect=False),
                timeout=self.query_s,
                # Pass the answer to the loop at once, not at the end of the query.
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError as error:
            log.warning("call of %s.%s not sent: %s", self.call.component, self.call.skill, error)
            self._settle()

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            return
        kind, answer = reply.ok.attachment, reply.ok.payload.to_bytes()
        is_progress = kind is not None and kind.to_bytes() == PROGRESS
        self.loop.call_soon_threadsafe(self.report if is_progress else self._settle, answer)

    def _on_end(self, began_s: float) -> None:
        # zenoh replies with an error to some queries that time out, and only ends the rest. A query ends early if no
        # process serves the component; if its server has just ended, the next query does.
        timed_out = time.monotonic() - began_s > self.query_s / 2.0
        self.loop.call_soon_threadsafe(self._settle, None, timed_out)

    def _settle(self, answer: bytes | None = None, asks_again: bool = False) -> None:
        if self.answered.done():
            return
        if asks_again and self.server() == self.asked_of:
            self.ask()
        else:
            self.answered.set_result(answer)


def send(session: zenoh.Session, call: SkillCall) -> None:
    """Call without waiting for an answer, ahead of all other messages that wait to be sent."""
    ignored = zenoh.handlers.Callback(lambda reply: None, indirect=False)
    _query(session, call, ignored, timeout=SENT_LIMIT_S, priority=zenoh.Priority.REAL_TIME, express=True)


def _query(
    session: zenoh.Session, call: SkillCall, handler: "zenoh.handlers.Callback[zenoh.Reply]", **how: Any
) -> None:
    attachment = call.schema + call.call_id.encode()
    session.get(f"call/{call.component}/{call.skill}", handler, payload=call.arguments, attachment=attachment, **how)


def cancel(session: zenoh.Session, component: str, call_id: str) -> None:
    """Request that the component cancels a call; its answer is then ``Cancelled``."""
    if not session.is_closed():
        session.put(f"cancel/{component}", call_id.encode(), congestion_control=zenoh.CongestionControl.BLOCK)


class CallServer:
    """Answers calls to one component on the loop, each in its own task, so that it can be cancelled."""

    def __init__(
        self,
        session: zenoh.Session,
        component: str,
        handler: CallHandler,
        cancelled: bytes,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        """`cancelled` is the encoded outcome of a call that was cancelled."""
        self._component = component
        self._handler = handler
        self._cancelled = cancelled
        self._loop = loop
        self._tasks: dict[str, asyncio.Task[bytes]] = {}
        self._queries: dict[str, zenoh.Query] = {}
        """The newest query that asks for each running call: earlier ones have timed out."""
        self._cancelled_early: deque[str] = deque(maxlen=CALLS_REMEMBERED)
        self._closing = False
        # The token is declared last: a process that sees it may call.
        self._cancels = session.declare_subscriber(f"cancel/{component}", self._on_cancel)
        with threads_urgent():  # the call may be a brake command; its thread only passes it to the loop
            self._calls = session.declare_queryable(f"call/{component}/*", self._on_query)
        self._token = session.liveliness().declare_token(f"alive/{component}/{session.zid()}")

    async def close(self, timeout_s: float) -> None:
        """Accept no more calls, cancel running ones, and wait up to `timeout_s` for their answers."""
        self._closing = True
        self._token.undeclare()
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=timeout_s)
        self._calls.undeclare()
        self._cancels.undeclare()

    def cancel_all_of(self, caller: str) -> None:
        """Cancel the running calls of a caller whose session has ended; only on the loop's thread."""
        for call_id, task in list(self._tasks.items()):
            if call_id.rpartition("-")[0] == caller:
                task.cancel()
                # Log only after the call has ended and its arm has stopped: writing a log line may block.
                task.add_done_callback(_log_caller_gone)

    def _on_query(self, query: zenoh.Query) -> None:
        payload, attachment = query.payload, query.attachment
        if payload is None or attachment is None or len(attachment) <= FINGERPRINT_BYTES:
            query.drop()
            return
        self._loop.call_soon_threadsafe(self._start, query, payload.to_bytes(), attachment.to_bytes())

    def _start(self, query: zenoh.Query, arguments: bytes, attachment: bytes) -> None:
        if self._closing:
            query.drop()
            return
        call_id = attachment[FINGERPRINT_BYTES:].decode(errors="replace")
        if call_id in self._cancelled_early:
            self._queries[call_id] = query
            self._answer(call_id)
            return
        if (earlier := self._queries.get(call_id)) is not None:
            self._queries[call_id] = query
            earlier.drop()
            return
        call = SkillCall(
            component=self._component,
            # Only the key selects the skill: a host that may only stop an arm has no key that moves it.
            skill=str(query.key_expr).rpartition("/")[2],
            arguments=arguments,
            call_id=call_id,
            caller=call_id.rpartition("-")[0],
            schema=attachment[:FINGERPRINT_BYTES],
        )
        self._queries[call_id] = query
        task = asyncio.ensure_future(self._handler(call, partial(self._report, call_id)))
        task.set_name(f"call {call_id}")
        self._tasks[call_id] = task
        task.add_done_callback(partial(self._answer, call_id))

    def _report(self, call_id: str, progress: bytes) -> None:
        if (query := self._queries.get(call_id)) is not None:
            try:
                query.reply(query.key_expr, progress, attachment=PROGRESS)
            except zenoh.ZError as error:
                log.warning("progress report not sent: %s", error)

    def _answer(self, call_id: str, task: "asyncio.Task[bytes] | None" = None) -> None:
        """Send the result of a call's task; without one, or if it was cancelled, that the call was cancelled."""
        self._tasks.pop(call_id, None)
        query = self._queries.pop(call_id)
        try:
            answer = self._cancelled if task is None or task.cancelled() else task.result()
            query.reply(query.key_expr, answer, attachment=OUTCOME)
        except zenoh.ZError as error:
            log.warning("answer not sent: %s", error)
        finally:
            query.drop()

    def _on_cancel(self, sample: zenoh.Sample) -> None:
        call_id = sample.payload.to_bytes().decode(errors="replace")
        self._loop.call_soon_threadsafe(self._cancel, call_id)

    def _cancel(self, call_id: str) -> None:
        task = self._tasks.get(call_id)
        if task is None:
            self._cancelled_early.append(call_id)
        else:
            task.cancel()


def _log_caller_gone(task: "asyncio.Task[bytes]") -> None:
    log.warning("%s was cancelled: its caller has ended", task.get_name())
