"""Real-time priority: requested where allowed, optional where not, and never inherited by workers."""

import asyncio
import gc
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import pytest

from dlokit.communication import topics
from dlokit.communication.timing.urgency import (
    REST_S,
    WINDOW_S,
    BoundedUrgency,
    garbage_frozen,
    make_urgent,
    may_be_urgent,
    threads_urgent,
)

T = TypeVar("T")

allowed = pytest.mark.skipif(not may_be_urgent(), reason="this system allows no real-time priority; see dlokit doctor")
LITTLE, MUCH = 0.2, 0.8  # fractions of a core: well below and well above the limit


def on_a_thread(work: Callable[[], T]) -> T:
    """Result of `work` on a separate thread, so that the thread of other tests does not become urgent."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()


def policy_of_a_new_thread() -> int:
    """Scheduling policy of a thread that the calling one starts, without flags."""
    told: list[int] = []
    thread = threading.Thread(target=lambda: told.append(os.sched_getscheduler(0)))
    thread.start()
    thread.join()
    return told[0] & ~os.SCHED_RESET_ON_FORK


def policy_of_a_new_process() -> int:
    """Scheduling policy of a process that the calling thread starts."""
    command = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
    return int(subprocess.run(command, capture_output=True, check=True, timeout=60).stdout)


THREADS_OF_THE_BUS = """
import asyncio, os, threading
from pathlib import Path
from dlokit.communication import topics
from dlokit.communication.wire import codec
from dlokit.communication.zenoh import calls
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.skills.robot import api as robot
from dlokit.types.system import Heartbeat
from dlokit.types.outcome import Succeeded

def tell(name, thread=0):
    print(name, os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK, sep=":")

def noted(server, query):
    tell("takes calls")
    take(server, query)

take, calls.CallServer._on_query = calls.CallServer._on_query, noted

async def stopped(request, report):
    return codec.encode(Succeeded(result=None))

async def main():
    bus = ZenohTransport(ZenohConfig(namespace="dlokit_test/urgent"))
    bus.latest(topics.FLOW)
    heard = threading.Event()

    def hear(data):
        tell("hears heartbeats")
        heard.set()

    bus.tap(topics.HEARTBEAT, hear)
    bus.publish(topics.HEARTBEAT, Heartbeat(stamp_ns=0, holder="me"))
    assert await asyncio.to_thread(heard.wait, 10.0)
    bus.serve("robot", stopped)
    assert await bus.wait_for("robot", 10.0)
    assert isinstance(await bus.call(robot.STOP), Succeeded)
    ours = {thread.native_id: thread.name for thread in threading.enumerate()}
    for task in Path("/proc/self/task").iterdir():
        tell(ours.get(int(task.name), (task / "comm").read_text().strip()), int(task.name))
    await bus.close()

asyncio.run(main())
"""


class Granted:
    """A machine whose clock and CPU time the test sets, and which records the granted priorities."""

    def __init__(self) -> None:
        self.now_s = self.used_s = 0.0
        self.urgent: list[bool] = []
        self.urgency = BoundedUrgency(lambda: self.now_s, lambda: self.used_s, self.urgent.append)

    def go_on(self, share: float, *, wanted: bool = True) -> None:
        """Slightly more than a window in which the thread computes for that fraction of the time, in steps of 10 ms."""
        for _ in range(round(WINDOW_S / 0.01) + 2):
            self.urgency(wanted)
            self.now_s += 0.01
            self.used_s += share * 0.01


@pytest.mark.live
@allowed
def test_an_urgent_thread_starts_ordinary_threads_and_processes() -> None:
    def story() -> tuple[int, int, int]:
        assert make_urgent()
        return os.sched_getscheduler(0), policy_of_a_new_thread(), policy_of_a_new_process()

    own, thread, process = on_a_thread(story)
    assert own == os.SCHED_RR | os.SCHED_RESET_ON_FORK
    assert (thread, process) == (os.SCHED_OTHER, os.SCHED_OTHER)


@allowed
def test_threads_that_a_library_starts_in_the_context_are_urgent_and_later_ones_are_not() -> None:
    def story() -> tuple[int, int, int]:
        with threads_urgent():
            meanwhile = policy_of_a_new_thread()
        return meanwhile, policy_of_a_new_thread(), os.sched_getscheduler(0)

    assert on_a_thread(story) == (os.SCHED_RR, os.SCHED_OTHER, os.SCHED_OTHER)


@allowed
def test_an_urgent_thread_keeps_its_priority_after_the_context() -> None:
    def story() -> int:
        make_urgent()
        with threads_urgent():
            pass
        return os.sched_getscheduler(0)

    assert on_a_thread(story) == os.SCHED_RR | os.SCHED_RESET_ON_FORK


@allowed
def test_a_released_priority_can_be_requested_again() -> None:
    def story() -> list[int]:
        urgency, policies = BoundedUrgency(), list[int]()
        for wanted in (True, False, True):
            urgency(wanted)
            policies.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)
        return policies

    assert on_a_thread(story) == [os.SCHED_RR, os.SCHED_OTHER, os.SCHED_RR]


def test_if_the_system_refuses_the_thread_stays_ordinary(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError("Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    _nothing_is_urgent()


def test_on_other_systems_the_thread_stays_ordinary(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("sched_setscheduler", "sched_getscheduler", "sched_getparam", "sched_param", "SCHED_RR"):
        monkeypatch.delattr(os, name)  # as on macOS
    _nothing_is_urgent()


def _nothing_is_urgent() -> None:
    def story() -> bool:
        urgency = BoundedUrgency()
        urgency(True)
        urgency(False)
        with threads_urgent():
            return make_urgent()

    assert not on_a_thread(story)
    assert not may_be_urgent()


def test_a_thread_that_computes_little_keeps_its_priority() -> None:
    machine = Granted()
    machine.go_on(LITTLE)
    machine.go_on(LITTLE)
    assert machine.urgent == [True]
    machine.go_on(LITTLE, wanted=False)
    assert machine.urgent == [True, False]


def test_a_thread_that_computes_much_is_ordinary_for_a_while() -> None:
    machine = Granted()
    machine.go_on(MUCH)
    assert machine.urgent == [True, False]
    machine.go_on(LITTLE)  # it computes little because other threads occupy the cores
    assert machine.urgent == [True, False]
    machine.now_s += REST_S
    machine.go_on(MUCH)
    assert machine.urgent == [True, False, True, False]


def test_earlier_computation_does_not_count() -> None:
    machine = Granted()
    machine.go_on(MUCH, wanted=False)
    machine.go_on(LITTLE)
    assert machine.urgent == [True]


@pytest.mark.live
@allowed
def test_the_threads_of_the_bus_are_urgent_and_the_loop_is_not() -> None:
    told = subprocess.run(
        [sys.executable, "-c", THREADS_OF_THE_BUS], capture_output=True, check=True, text=True, timeout=60
    ).stdout
    policies = {name: int(policy) for name, policy in (line.rsplit(":", 1) for line in told.splitlines())}
    zenoh_s = {name for name in policies if name.startswith(("net-", "app-", "acc-", "rx-", "tx-"))}
    ours = (f"reads {topics.FLOW.name}", "hears heartbeats", "takes calls")
    assert zenoh_s
    assert {name: policies[name] for name in (*zenoh_s, *ours)} == dict.fromkeys((*zenoh_s, *ours), os.SCHED_RR)
    assert policies["MainThread"] == os.SCHED_OTHER


def test_earlier_objects_are_excluded_from_garbage_collection() -> None:
    async def scenario() -> None:
        async with garbage_frozen():
            assert gc.get_freeze_count() > 1000  # what Python itself has loaded
        assert gc.get_freeze_count() == 0

    asyncio.run(scenario())


def test_few_new_objects_suffice_for_a_full_collection_beside_many_earlier_ones() -> None:
    def full_collections() -> int:
        return gc.get_stats()[2]["collections"]

    async def scenario() -> None:
        async with garbage_frozen():
            before = full_collections()
            new = [[number] for number in range(enough)]
            assert full_collections() > before
            assert len(new) < len(earlier) / 4

    first, second, third = gc.get_threshold()  # of 700 objects to Python 3.12, 2000 from 3.13 on
    enough = round(1.5 * first * (second + 1) * (third + 1))  # a full collection is due at two thirds of them
    earlier = [[number] for number in range(5 * enough)]
    gc.collect()
    asyncio.run(scenario())
