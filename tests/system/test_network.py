"""A live system opens no port, and is not visible to another system on the same machine."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack
from pathlib import Path

import psutil
import pytest
import zenoh
from tiny_process import ECHO
from tiny_system import echo_row, tiny_system

from dlokit.communication import topics
from dlokit.communication.zenoh.session import open_session
from dlokit.system.live import LiveSystem
from dlokit.system.processes.sockets import local_bus
from dlokit.types.flow import Command, OperatorCommand
from dlokit.types.outcome import Succeeded

pytestmark = pytest.mark.live

WAIT_S = 60.0  # starting a process takes a second; many on a loaded machine take more


def test_a_live_system_has_no_socket_of_the_internet_protocols(tmp_path: Path) -> None:
    async def main() -> None:
        before = psutil.Process().net_connections(kind="inet")
        async with asyncio.timeout(WAIT_S), tiny_system(tmp_path, echo_row()) as system:
            assert psutil.Process().net_connections(kind="inet") == before
            for pid in system.supervisor.pids.values():
                assert psutil.Process(pid).net_connections(kind="inet") == []

    asyncio.run(main())


def test_peers_that_join_at_the_same_time_all_find_each_other() -> None:
    names = ("cell", "robot", "camera", "observer", "simulation")
    with local_bus("dlokit_test_together") as bus, ThreadPoolExecutor(len(names)) as threads:
        first = open_session(bus.first())
        before = [names[:number] for number in range(len(names))]
        others = list(threads.map(lambda name, them: open_session(bus.process(name, them)), names, before))
        end_s = time.monotonic() + WAIT_S
        try:
            for session in (first, *others):
                while len(session.info.peers_zid()) < len(names):
                    assert time.monotonic() < end_s
                    time.sleep(0.01)
        finally:
            for session in (first, *others):
                session.close()


@pytest.mark.parametrize("connects", ["the frozen one", "the other"])
def test_a_link_that_was_closed_because_a_process_hung_is_opened_again(connects: str) -> None:
    # Neither is the first process, to which all connect: of those that find each other zenoh opens no link again.
    names = ("a", "z")
    frozen_first = connects == "the other"
    frozen, other = names if frozen_first else names[::-1]
    with local_bus("dlokit_test_hangs") as bus:
        first = open_session(bus.first())
        session = open_session(bus.process(other, (frozen,) if frozen_first else ()))
        arguments = (bus.namespace, str(bus.folder), bus.key, frozen, *(() if frozen_first else (other,)))
        script = Path(__file__).parent / "peer_that_hangs.py"
        child = subprocess.Popen((sys.executable, str(script), *arguments))
        try:
            answered = threading.Event()
            heard = session.declare_subscriber("topic/answer", lambda _: answered.set())
            asking = session.declare_publisher("topic/ask", congestion_control=zenoh.CongestionControl.BLOCK)
            _ask_until(asking, answered.is_set)
            before = set(session.info.peers_zid())
            os.kill(child.pid, signal.SIGSTOP)
            _ask_until(asking, lambda: set(session.info.peers_zid()) < before)
            os.kill(child.pid, signal.SIGCONT)
            answered.clear()
            _ask_until(asking, answered.is_set)
            heard.undeclare()
        finally:
            child.kill()
            child.wait()
            session.close()
            first.close()


def _ask_until(asking: zenoh.Publisher, reached: Callable[[], bool]) -> None:
    """Publish large messages that may not be dropped, until something is so."""
    end_s = time.monotonic() + WAIT_S
    while not reached():
        assert time.monotonic() < end_s
        asking.put(bytes(100_000))
        time.sleep(0.01)


def test_two_systems_of_one_machine_do_not_see_each_other(tmp_path: Path) -> None:
    async def main() -> None:
        async with asyncio.timeout(2 * WAIT_S), AsyncExitStack() as stack:
            one = await stack.enter_async_context(tiny_system(tmp_path / "one", echo_row()))
            other = await stack.enter_async_context(tiny_system(tmp_path / "other"))
            assert isinstance(await one.transport.call(ECHO, "here"), Succeeded)
            assert not other.transport.alive("echo").alive
            await nothing_crosses(one, other)

    asyncio.run(main())


async def nothing_crosses(one: LiveSystem, other: LiveSystem) -> None:
    """A command published in one system arrives in it, and not in the other."""
    heard = one.transport.stream(topics.COMMAND)
    assert other.transport.latest(topics.COMMAND).value is None
    one.transport.publish(topics.COMMAND, OperatorCommand(stamp_ns=1, seq=1, command=Command.PAUSE))
    assert (await anext(heard)).command is Command.PAUSE
    ticks = other.transport.stream(topics.CLOCK)
    for _ in range(10):  # the other system has had as much time to receive it
        await anext(ticks)
    assert other.transport.latest(topics.COMMAND).value is None
