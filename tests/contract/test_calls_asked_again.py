"""A call that takes longer than zenoh keeps its query: it is asked for again, and runs once.

zenoh keeps a part of each query until the query's time-out, which is therefore short.
"""

import asyncio
import gc
import weakref
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
import zenoh
from buses import new_bus
from transport_grid import PATIENT, WAIT_S, eventually

from dlokit.communication.skill import ReportingSkill, SkillCall
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.communication.zenoh import calls
from dlokit.communication.zenoh.session import ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.types.outcome import Succeeded, Unreachable

pytestmark = pytest.mark.live

SHORT_S = 0.2
"""Time-out of a query in these tests [s]."""


def _work() -> None:
    """Work until the test ends it."""
    ...


WORK = ReportingSkill("worker", "work", _work, timeout_s=3600.0, reports=int)


class Noting:
    """A session whose queries are noted."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self.asked: list[tuple[str, float]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def get(self, key: str, *args: Any, timeout: float, **kwargs: Any) -> Any:
        self.asked.append((key, timeout))
        return self._session.get(key, *args, timeout=timeout, **kwargs)


@dataclass
class Pair:
    """A caller and the server of `worker`, with what each has seen."""

    caller: ZenohTransport
    session: Any
    """The caller's, a `Noting`."""
    served_by: zenoh.Session
    runs: int = 0
    released: asyncio.Event = field(default_factory=asyncio.Event)
    report: Report = field(default=lambda progress: None)
    stopped: bool = False

    async def work(self, call: SkillCall, report: Report) -> bytes:
        self.runs, self.report = self.runs + 1, report
        try:
            await self.released.wait()
        finally:
            self.stopped = True
        return codec.encode(Succeeded(result=None))

    async def asked(self, times: int) -> None:
        """Wait until the caller has asked so often."""
        await eventually(lambda: len(self.session.asked) >= times)


@asynccontextmanager
async def pair(query_s: float = PATIENT.query_s) -> AsyncGenerator[Pair]:
    bus, sessions = new_bus(), list[Any]()

    def noting(config: ZenohConfig) -> Any:
        sessions.append(Noting(open_session(config)))
        return sessions[-1]

    patience = replace(PATIENT, query_s=query_s)
    server = ZenohTransport(bus.first(), open_session=noting, patience=patience)
    caller = ZenohTransport(bus.guest, open_session=noting, patience=patience)
    both = Pair(caller, sessions[1], sessions[0])
    try:
        async with asyncio.timeout(WAIT_S * 2):
            server.serve("worker", both.work)
            assert await caller.wait_for("worker", WAIT_S)
            yield both
    finally:
        both.released.set()
        await caller.close()
        await server.close()


def test_a_query_times_out_early_whatever_the_limit_of_its_skill() -> None:
    async def main() -> None:
        async with pair() as both:
            both.released.set()
            assert isinstance(await both.caller.call(WORK), Succeeded)
            assert both.session.asked == [("call/worker/work", calls.QUERY_TIMEOUT_S)]
            assert WORK.timeout_s > 10.0 * calls.QUERY_TIMEOUT_S

    asyncio.run(main())


def test_a_call_asked_for_again_runs_once_reports_and_is_answered() -> None:
    progress: list[int] = []

    async def main() -> None:
        async with pair(SHORT_S) as both:
            call = asyncio.create_task(both.caller.call_reported(WORK, progress.append))
            for times in (1, 2, 3):
                await both.asked(times)
                # The first report after an asking may still go to the query before.
                while times not in progress:
                    both.report(codec.encode(times))
                    await asyncio.sleep(0.01)
            assert both.runs == 1  # the third query has brought a report
            both.released.set()
            assert isinstance(await call, Succeeded)

    asyncio.run(main())


def test_a_call_asked_for_again_can_be_cancelled() -> None:
    async def main() -> None:
        async with pair(SHORT_S) as both:
            call = asyncio.create_task(both.caller.call(WORK))
            await both.asked(3)
            call.cancel()
            await asyncio.wait({call})
            assert call.cancelled()
            assert both.stopped
            asked = len(both.session.asked)
            await asyncio.sleep(3.0 * SHORT_S)
            assert len(both.session.asked) == asked

    asyncio.run(main())


def test_a_call_asked_for_again_is_unreachable_when_its_server_has_ended() -> None:
    async def main() -> None:
        async with pair(SHORT_S) as both:
            call = asyncio.create_task(both.caller.call(WORK))
            await both.asked(3)
            await asyncio.to_thread(both.served_by.close)
            assert isinstance(await call, Unreachable)

    asyncio.run(main())


def test_a_call_is_not_asked_for_again_from_another_server() -> None:
    async def main() -> None:
        async with pair(SHORT_S) as both:
            request, loop = WORK.request("id-1", "id"), asyncio.get_running_loop()
            call = calls.Call(
                both.session,
                loop,
                request,
                lambda progress: None,
                lambda: "restarted",
                asked_of="first",
                query_s=SHORT_S,
            )
            call.ask()
            assert await call.answered is None
            assert len(both.session.asked) == 1

    asyncio.run(main())


def test_an_answered_call_leaves_nothing_for_garbage_collection() -> None:
    """Answers are pictures of 2 MB: the camera kept up to 22 of them in reference cycles, until a full collection."""

    async def main() -> None:
        async with pair() as both:
            both.released.set()
            request, loop = WORK.request("id-1", "id"), asyncio.get_running_loop()
            call = calls.Call(both.session, loop, request, lambda progress: None, lambda: "", asked_of="")
            call.ask()
            assert await call.answered is not None
            left = weakref.ref(call.answered)
            del call

            def gone() -> bool:
                both.session.zid()  # zenoh releases what its threads have dropped when it next holds Python's lock
                return left() is None

            await eventually(gone)

    gc.collect()
    gc.disable()
    try:
        asyncio.run(main())
    finally:
        gc.enable()
