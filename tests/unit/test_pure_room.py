"""A test outside the live rooms that starts a process, opens a socket, sleeps or writes elsewhere fails by itself."""

import asyncio
import os
import selectors
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from pure_room import ImpureTest, PureRoom

from dlokit.communication.timing import virtual_time
from dlokit.communication.zenoh.session import ZenohConfig, open_session


def starts_a_process() -> None:
    subprocess.run([sys.executable, "-c", ""], check=True)


def forks() -> None:
    os.fork()


def binds_a_socket() -> None:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))


def connects_a_unix_socket() -> None:
    with socket.socket(socket.AF_UNIX) as client:
        client.connect("/nowhere")


def opens_a_zenoh_session() -> None:
    open_session(ZenohConfig(namespace="x"))


def sleeps() -> None:
    time.sleep(0.03)


def writes_beside_the_sources() -> None:
    Path(__file__).with_name("left.txt").write_text("x")


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (starts_a_process, "starts a process"),
        (forks, "starts a process"),
        (binds_a_socket, "opens a socket"),
        (connects_a_unix_socket, "opens a socket"),
        (opens_a_zenoh_session, "opens a zenoh session"),
        (sleeps, "sleeps for 0.03 s"),
        (writes_beside_the_sources, "left.txt: write below `tmp_path`"),
    ],
)
def test_it_is_refused_before_it_happens_and_noted_for_code_that_catches_the_error(
    pure_room: PureRoom, act: Callable[[], None], said: str
) -> None:
    with pytest.raises(ImpureTest, match=said):
        act()
    assert said in " ".join(pure_room.forget())


def test_a_wait_whose_time_runs_out_is_a_sleep(pure_room: PureRoom) -> None:
    threading.Event().wait(0.03)
    assert "waits for 0.03 s" in pure_room.forget()[0]
    with selectors.DefaultSelector() as selector:  # what an event loop waits with
        selector.select(0.03)
    assert "waits for 0.03 s" in pure_room.forget()[0]


def test_virtual_time_and_a_wait_that_something_ends_are_allowed(pure_room: PureRoom) -> None:
    virtual_time.run(asyncio.sleep(3600.0))
    done = threading.Event()
    thread = threading.Thread(target=done.set)
    thread.start()
    assert done.wait(60.0)
    thread.join()
    assert pure_room.forget() == []


def test_what_a_thread_of_an_earlier_test_does_is_not_this_tests(pure_room: PureRoom) -> None:
    next_test = threading.Event()

    def ends_late() -> None:
        next_test.wait(60.0)
        time.sleep(0.03)

    thread = threading.Thread(target=ends_late)
    thread.start()
    pure_room.enter(pure_room.writable)
    next_test.set()
    thread.join()
    assert pure_room.forget() == []


def test_a_thread_that_goes_on_fails_the_test_that_started_it(pure_room: PureRoom) -> None:
    end = threading.Event()
    thread = threading.Thread(target=end.wait, name="left behind")
    thread.start()
    try:
        with pytest.raises(ImpureTest, match="leaves the thread 'left behind'"):
            pure_room.leave(thread_ends_s=0.0)
    finally:
        pure_room.enter(pure_room.writable)
        end.set()
        thread.join()
