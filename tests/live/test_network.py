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
        others = list(threads.map(lambda name: open_session(bus.process(name, names)), names))
        end_s = time.monotonic() + WAIT_S
        try:
            for session in (first, *others):
                while len(session.info.peers_zid()) < len(names):
                    assert time.monotonic() < end_s
                    time.sleep(0.01)
        finally:
            for session in (first, *others):
                session.close()


@pytest.mark.parametrize("role", ["an earlier process", "a later process", "a guest"])
def test_a_link_that_was_closed_because_a_process_hung_is_reopened(role: str) -> None:
    """The frozen process and the other one are linked to the first process all the time."""
    with local_bus("dlokit_test_hangs") as bus:
        first = open_session(bus.first())
        names = ("frozen", "other") if role == "a later process" else ("other", "frozen")
        arguments = (bus.namespace, str(bus.folder), bus.key, "frozen", *names)
        script = Path(__file__).parent / "peer_that_hangs.py"
        child = subprocess.Popen((sys.executable, str(script), *arguments))
        listens = bus.folder / "frozen"
        _wait_until(listens.is_socket)
        session = open_session(bus.guest if role == "a guest" else bus.process("other", names))
        try:
            answered = threading.Event()
            heard = session.declare_subscriber("topic/answer", lambda _: answered.set())
            asking = session.declare_publisher("topic/ask", congestion_control=zenoh.CongestionControl.BLOCK)

            def asks() -> None:
                asking.put(bytes(100_000))  # a few fill the link to a frozen process

            _wait_until(answered.is_set, asks)
            before = set(session.info.peers_zid())
            os.kill(child.pid, signal.SIGSTOP)
            _wait_until(lambda: set(session.info.peers_zid()) < before, asks)
            os.kill(child.pid, signal.SIGCONT)
            answered.clear()
            _wait_until(answered.is_set, asks)
            heard.undeclare()
        finally:
            child.kill()
            child.wait()
            session.close()
            first.close()


def _wait_until(reached: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None) -> None:
    end_s = time.monotonic() + WAIT_S
    while not reached():
        assert time.monotonic() < end_s
        meanwhile()
        time.sleep(0.01)  # zenoh has no event for a link that opens or closes


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
