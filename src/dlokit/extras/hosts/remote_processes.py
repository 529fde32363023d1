"""Processes on other hosts as seen by the main host: it waits for them, starts, watches and ends them."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

from dlokit import __version__
from dlokit.communication.container import end_tasks
from dlokit.errors import ProcessFailure
from dlokit.extras.hosts.api import HELLO, RUN_SHARE, ShareReady
from dlokit.extras.hosts.placement import AGENT
from dlokit.system.processes.bus import SystemTransport
from dlokit.system.table import ProcessRow
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded, Unreachable

log = logging.getLogger(__name__)

UNKNOWN_VERSIONS = ("unknown", "0+unknown")
"""Versions of dlokit that is imported from a source folder, or was built without git."""
CLOCK_OFF_S = 0.5
"""A larger clock difference between hosts is reported, because certificates and logs use the time of day [s]."""
AT_ONCE_S = 1.0
"""Time after which the user is informed about missing hosts; running hosts are found earlier [s]."""
TOLD_EVERY_S = 5.0
GONE_WITHIN_S = 10.0
"""Time after which a host that was killed while its link was cut is known to be gone [s]."""
AGAIN_S = 1.0
"""Delay before processes are started again: their host may still be ending the previous ones [s]."""


class RemoteProcesses:
    """Manages the processes on other hosts."""

    def __init__(
        self,
        transport: SystemTransport,
        shares: Mapping[str, tuple[ProcessRow, ...]],
        config_toml: str,
        wait_s: float,
        say: Callable[[str], None],
        gone_within_s: float = GONE_WITHIN_S,
    ) -> None:
        """Each host is awaited for `wait_s`; `say` informs the user about the progress."""
        self._gone_within_s = gone_within_s
        self._transport = transport
        self._shares = {host: share for host, share in shares.items() if share}
        self._onlookers = [host for host, share in shares.items() if not share]
        self._config_toml = config_toml
        self._wait_s = wait_s
        self._say = say
        self._running: dict[str, asyncio.Task[Outcome[None]]] = {}
        self._ready: dict[str, asyncio.Event] = {host: asyncio.Event() for host in self._shares}

    async def start(self) -> None:
        """Start all processes. Raises `ProcessFailure`: host_missing, host_version, or the cause of a failed start."""
        try:
            await self._find_all()
            for host, share in self._shares.items():
                self._running[host] = asyncio.create_task(self._run(host, share), name=f"share of {host}")
            await self._all_ready()
            for host in self._onlookers:
                self._running[host] = asyncio.create_task(self._run(host, ()), name=f"share of {host}")
        except BaseException:  # including Ctrl-C: no process may remain
            await self.end()
            raise

    async def end(self) -> None:
        """End all processes."""
        await end_tasks(*self._running.values())

    async def wait_failed(self) -> None:
        """Never return, but raise `ProcessFailure` when processes of a host have ended, or the host is gone."""
        if not self._running:
            await asyncio.Event().wait()
        done, _ = await asyncio.wait(self._running.values(), return_when=asyncio.FIRST_COMPLETED)
        for host, task in self._running.items():
            if task in done:
                raise _why(host, task.result())

    async def _find_all(self) -> None:
        missing = list(self._shares)
        now_s = asyncio.get_running_loop().time
        end_s = now_s() + self._wait_s
        patience_s = AT_ONCE_S
        while missing:
            left_s = max(0.0, min(end_s - now_s(), patience_s))
            there = await asyncio.gather(*(self._transport.wait_for(f"{AGENT}.{host}", left_s) for host in missing))
            missing = [host for host, found in zip(missing, there, strict=True) if not found]
            if missing and now_s() >= end_s:
                raise ProcessFailure(
                    f"host_missing: {', '.join(missing)}",
                    f"not found within {self._wait_s:g} s; run `dlokit host {missing[0]}` there, and check its "
                    "output and the firewall's port",
                )
            if missing:
                self._say(f"waiting for the host{'s' * (len(missing) > 1)} {', '.join(missing)}")
            patience_s = TOLD_EVERY_S
        for host in self._shares:
            await self._greet(host)

    async def _greet(self, host: str) -> None:
        asked_ns = time.time_ns()
        said = await self._transport.call(HELLO.at(host))
        answered_ns = time.time_ns()
        if not isinstance(said, Succeeded):
            raise _why(host, said)
        if said.result.version != __version__:
            raise ProcessFailure(
                f"host_version: {host}", f"dlokit {said.result.version} there, {__version__} here; install the same"
            )
        if __version__ in UNKNOWN_VERSIONS:
            log.warning(
                "version_unknown: dlokit is %s on host %s and here, which may differ; install both from one wheel, or "
                "from a clone with git",
                __version__,
                host,
            )
        off_s = (said.result.wall_ns - (asked_ns + answered_ns) / 2) / 1e9
        if abs(off_s) - (answered_ns - asked_ns) / 2e9 > CLOCK_OFF_S:
            log.warning(
                "clocks_differ: the clock of host %s is %.1f s %s; let NTP or PTP set both",
                host,
                abs(off_s),
                "ahead" if off_s > 0 else "behind",
            )

    async def _run(self, host: str, share: tuple[ProcessRow, ...]) -> Outcome[None]:
        """Run the processes of a host; restart them when the host was lost and is back, if they may be restarted."""
        while True:
            outcome = await self._run_once(host, tuple(row.name for row in share))
            if not _for_a_while(outcome) or not all(row.restart.times for row in share):
                if any(row.essential for row in share) or (share and not self._ready[host].is_set()):
                    return outcome
                log.warning("the run continues without host %s: %s", host, _why(host, outcome))
                await asyncio.Event().wait()
            if share and isinstance(outcome, Unreachable):
                log.warning("host_lost: %s; its processes are started again when it is back", host)
            if not await self._back(host, share):
                return outcome

    async def _run_once(self, host: str, names: tuple[str, ...]) -> Outcome[None]:
        if not await self._alone(host):
            return Failed(
                reason=f"host_twice: {host}", detail=f"`dlokit host {host}` runs more than once: end all but one"
            )

        def note(ready: ShareReady) -> None:
            if (event := self._ready.get(host)) is not None:
                event.set()

        return await self._transport.call_reported(RUN_SHARE.at(host), note, self._config_toml, names)

    async def _alone(self, host: str) -> bool:
        """Whether only one host has the name: two would both run the processes. A killed one disappears soon."""
        now_s = asyncio.get_running_loop().time
        end_s = now_s() + self._gone_within_s
        while self._transport.serving(f"{AGENT}.{host}") > 1:
            if now_s() > end_s:
                return False
            await asyncio.sleep(AGAIN_S)
        return True

    async def _back(self, host: str, share: tuple[ProcessRow, ...]) -> bool:
        """Wait for a lost host, or for one that still ends its previous processes; False if these are essential."""
        await asyncio.sleep(AGAIN_S)
        needed = any(row.essential for row in share)
        while not await self._transport.wait_for(f"{AGENT}.{host}", self._wait_s):
            if needed:
                return False
        return True

    async def _all_ready(self) -> None:
        within_s = sum(row.ready_within_s for share in self._shares.values() for row in share)
        failing = asyncio.create_task(self.wait_failed(), name="a share fails")
        ready = asyncio.create_task(self._until_ready(), name="all shares ready")
        try:
            await asyncio.wait({failing, ready}, timeout=within_s, return_when=asyncio.FIRST_COMPLETED)
            if failing.done():
                failing.result()
            if not ready.done():
                late = ", ".join(host for host, event in self._ready.items() if not event.is_set())
                raise ProcessFailure(f"host_not_ready: {late}", f"not within {within_s:g} s; see the logs there")
        finally:
            await end_tasks(failing, ready)

    async def _until_ready(self) -> None:
        for event in self._ready.values():
            await event.wait()


def _for_a_while(outcome: Outcome[Any]) -> bool:
    """Whether the request may succeed later: the host is gone, or is still ending its previous processes."""
    return isinstance(outcome, Unreachable) or (isinstance(outcome, Rejected) and outcome.reason == "busy")


def _why(host: str, outcome: Outcome[Any]) -> ProcessFailure:
    if isinstance(outcome, Failed | Rejected):
        return ProcessFailure(outcome.reason, f"on host {host}: {outcome.detail}")
    if isinstance(outcome, Unreachable):
        return ProcessFailure(f"host_lost: {host}", "the host or the connection to it is lost")
    return ProcessFailure(f"host_ended: {host}", f"its processes have ended: {outcome}")
