"""Sessions on the sockets of one machine: they find each other, and find each other again after one has hung."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import zenoh

from dlokit.communication.zenoh.session import ZenohConfig, open_session
from dlokit.errors import MachineError
from dlokit.system.processes.sockets import local_bus

WAIT_S = 60.0  # starting a process takes a second; many on a loaded machine take more


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


def test_a_bus_that_cannot_be_opened_says_what_was_found_and_only_what_helps(tmp_path: Path) -> None:
    taken = ZenohConfig(namespace="test", listen=(f"unixsock-stream/{tmp_path}/bus",))
    session = open_session(taken)
    try:
        with pytest.raises(MachineError, match=r"cannot listen on .*/bus.*; stop the process that listens there"):
            open_session(taken)
    finally:
        session.close()
    nowhere = ZenohConfig(namespace="test", listen=(f"unixsock-stream/{tmp_path}/none/bus",))
    with pytest.raises(MachineError, match=r"none/bus .*: No such file or directory") as caught:
        open_session(nowhere)
    assert "stop the process" not in str(caught.value)


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
