"""The main host's reaction to other hosts that are missing, have another version or time, or refuse."""

import asyncio
import logging
import re
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace

import pytest
from buses import new_bus
from transport_grid import eventually

from dlokit import __version__
from dlokit.communication.component import Component, implements, implements_reporting
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import ProcessFailure, SkillFailure, SkillRejected
from dlokit.extras.hosts.api import HELLO, RUN_SHARE, HostFacts, ShareReady
from dlokit.extras.hosts.remote_processes import CLOCK_OFF_S, RemoteProcesses
from dlokit.system.table import ROBOT, ProcessRow


@dataclass(frozen=True, kw_only=True)
class Manner:
    """How a host behaves."""

    version: str = __version__
    ahead_s: float = 0.0
    raises: Exception | None = None
    """Behaviour instead of running its processes."""
    ready_first: bool = False
    """Whether it reports that it is ready first."""


class OddHost(Component):
    name = "host"
    instance = "arm"

    def __init__(self, manner: Manner) -> None:
        super().__init__()
        self._manner = manner
        self.ran: list[tuple[str, tuple[str, ...]]] = []

    @implements(HELLO)
    async def hello(self) -> HostFacts:
        return HostFacts(version=self._manner.version, wall_ns=time.time_ns() + round(self._manner.ahead_s * 1e9))

    @implements_reporting(RUN_SHARE)
    async def run_share(
        self, report: Callable[[ShareReady], None], config_toml: str, processes: tuple[str, ...]
    ) -> None:
        self.ran.append((config_toml, processes))
        if self._manner.ready_first:
            report(ShareReady(host=self.instance))
        if self._manner.raises is not None:
            raise self._manner.raises
        report(ShareReady(host=self.instance))
        await asyncio.Event().wait()


@asynccontextmanager
async def shares_with(
    manner: Manner | None, row: ProcessRow = ROBOT, wait_s: float = 30.0
) -> AsyncGenerator[tuple[RemoteProcesses, OddHost]]:
    """The processes of a run on a host with this behaviour; None: the host is missing."""
    bus, odd = MemoryTransport(), OddHost(manner or Manner())
    host = Container(bus, LoopClock())
    shares = RemoteProcesses(bus, {"arm": (row,), "desk": ()}, "seed = 3", wait_s, lambda said: None)
    try:
        if manner is not None:
            host.add(odd)
        async with host:
            yield shares, odd
    finally:
        await shares.end()
        await bus.close()


async def failure_of_start(manner: Manner | None, wait_s: float = 30.0) -> ProcessFailure:
    async with shares_with(manner, wait_s=wait_s) as (shares, _):
        with pytest.raises(ProcessFailure) as raised:
            await shares.start()
        return raised.value


def test_a_host_gets_the_configuration_and_its_processes_and_is_ended() -> None:
    async def body() -> None:
        async with shares_with(Manner()) as (shares, odd):
            await shares.start()
            assert odd.ran == [("seed = 3", ("robot",))]

    virtual_time.run(body())


def test_a_host_that_does_not_connect_is_named() -> None:
    assert virtual_time.run(failure_of_start(None, wait_s=0.1)).reason == "host_missing: arm"


def test_a_host_of_another_version_is_named() -> None:
    failure = virtual_time.run(failure_of_start(Manner(version="0.0.1")))
    assert failure.reason == "host_version: arm"
    assert f"dlokit 0.0.1 there, {__version__} here" in failure.detail


@pytest.mark.parametrize(("version", "warned"), [("0+unknown", True), ("unknown", True), ("1.2+unknown.g0a1b", False)])
def test_equal_versions_that_are_not_known_are_no_proof(
    version: str, warned: bool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("dlokit.extras.hosts.remote_processes.__version__", version)

    async def body() -> None:
        async with shares_with(Manner(version=version)) as (shares, _):
            await shares.start()

    with caplog.at_level(logging.WARNING, "dlokit.extras.hosts.remote_processes"):
        virtual_time.run(body())
    assert (f"version_unknown: dlokit is {version} on host arm and here" in caplog.text) is warned


def test_a_host_that_refuses_or_fails_names_the_reason() -> None:
    refused = virtual_time.run(failure_of_start(Manner(raises=SkillRejected("bad_configuration", "no such strategy"))))
    assert (refused.reason, refused.detail) == ("bad_configuration", "on host arm: no such strategy")
    died = virtual_time.run(failure_of_start(Manner(raises=SkillFailure("process_died: robot", "signal 9"))))
    assert died.reason == "process_died: robot"


@pytest.mark.parametrize(("ahead_s", "said"), [(60.0, "ahead"), (-60.0, "behind"), (0.0, None)])
def test_a_host_whose_clock_is_off_is_named(ahead_s: float, said: str | None, caplog: pytest.LogCaptureFixture) -> None:
    assert abs(ahead_s) > CLOCK_OFF_S or said is None

    async def body() -> float:
        async with shares_with(Manner(ahead_s=ahead_s)) as (shares, _):
            began_s = time.monotonic()
            await shares.start()
            return time.monotonic() - began_s

    with caplog.at_level(logging.WARNING, "dlokit.extras.hosts.remote_processes"):
        took_s = virtual_time.run(body())
    warned = [record.getMessage() for record in caplog.records if "clocks_differ" in record.getMessage()]
    assert len(warned) == (said is not None)
    if said is not None:
        found = re.search(rf"(\d+\.\d) s {said}", warned[0])
        assert found is not None
        # The clocks are compared in the middle of a call: the error is at most half of its duration, and the rounding.
        assert float(found[1]) == pytest.approx(60.0, abs=took_s / 2.0 + 0.05)


def test_a_host_of_optional_processes_can_only_end_the_start_of_a_run(caplog: pytest.LogCaptureFixture) -> None:
    died = SkillFailure("process_died: viewer", "signal 9")
    viewer = replace(ROBOT, essential=False)

    async def body() -> None:
        async with shares_with(Manner(ready_first=True, raises=died), viewer) as (shares, _):
            await shares.start()
            failing = asyncio.create_task(shares.wait_failed())
            await eventually(lambda: "the run continues without host arm: process_died: viewer" in caplog.text)
            await asyncio.sleep(0.01)
            assert not failing.done()
            failing.cancel()
        async with shares_with(Manner(raises=died), viewer) as (shares, _):
            with pytest.raises(ProcessFailure, match="process_died: viewer"):
                await shares.start()

    with caplog.at_level(logging.WARNING, "dlokit.extras.hosts.remote_processes"):
        virtual_time.run(body())


HANGS_S = 60.0


@pytest.mark.live
def test_a_duplicate_host_is_named_and_neither_runs_its_processes() -> None:
    async def body() -> None:
        bus, hosts = new_bus(), (OddHost(Manner()), OddHost(Manner()))
        main = ZenohTransport(bus.first())
        shares = RemoteProcesses(main, {"arm": (ROBOT,)}, "seed = 3", HANGS_S, lambda said: None, gone_within_s=0.0)
        async with AsyncExitStack() as stack:
            stack.push_async_callback(main.close)
            stack.push_async_callback(shares.end)
            for host in hosts:
                transport = ZenohTransport(bus.client())
                stack.push_async_callback(transport.close)
                container = Container(transport, LoopClock())
                container.add(host)
                await stack.enter_async_context(container)
            async with asyncio.timeout(HANGS_S):
                await eventually(lambda: main.serving("host.arm") == len(hosts))
                with pytest.raises(ProcessFailure, match="host_twice: arm"):
                    await shares.start()
        assert all(host.ran == [] for host in hosts)

    asyncio.run(body())
