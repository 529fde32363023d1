"""The lease on a robot, and its watchdogs."""

import asyncio
import threading
import time

import pytest

from dlokit.communication.timing.clock import suspended_too_ns
from dlokit.communication.timing.deadlines import LoopWatchdog, ThreadWatchdog
from dlokit.errors import SkillRejected
from dlokit.skills.robot.lease import RobotLease

PATIENCE_S = 30.0  # it takes milliseconds; only a failing test waits this long


class Machine:
    """A monotonic clock that only the test advances."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> int:
        return round(self.now_s * 1e9)


def test_a_heartbeat_renews_the_lease_for_its_duration() -> None:
    machine = Machine()
    lease = RobotLease(machine)
    lease.renew("the decision process", 0.2)
    machine.now_s = 0.15
    lease.hear("the decision process")
    machine.now_s = 0.3
    assert not lease.lost
    assert lease.left_s == pytest.approx(0.05)
    machine.now_s = 0.35
    assert lease.lost


def test_a_heartbeat_of_another_caller_renews_nothing() -> None:
    machine = Machine()
    lease = RobotLease(machine)
    lease.renew("the decision process", 0.2)
    machine.now_s = 0.15
    lease.hear("another system")
    lease.hear("")
    machine.now_s = 0.25
    assert lease.lost
    lease.renew("another system", 0.2)  # an expired lease may be taken
    with pytest.raises(SkillRejected, match="another system holds the lease"):
        lease.renew("the decision process", 0.2)


def test_after_a_freeze_of_all_processes_the_first_heartbeat_does_not_revive_the_lease() -> None:
    machine = Machine()
    lease = RobotLease(machine)
    lease.renew("the decision process", 0.2)
    machine.now_s = 60.0  # frozen together, or suspended
    lease.hear("the decision process")  # before any watchdog has looked
    assert lease.lost
    lease.hear("the decision process")
    assert lease.lost
    lease.noted()  # the arm has been ordered to brake
    assert not lease.lost


def test_a_lease_whose_loss_was_noted_is_renewed_at_once() -> None:
    machine = Machine()
    lease = RobotLease(machine)
    lease.renew("the decision process", 0.2)
    machine.now_s = 5.0
    lease.noted()
    lease.renew("the decision process", 0.2)
    assert not lease.lost
    machine.now_s = 10.0
    lease.hear("the decision process")
    assert lease.lost  # another loss, which nothing has noted


def test_a_heartbeat_that_a_busy_machine_delays_revives_the_lease() -> None:
    machine = Machine()
    lease = RobotLease(machine)
    lease.renew("the decision process", 0.2)
    machine.now_s = 0.5
    lease.hear("the decision process")
    assert not lease.lost


def test_the_clock_of_leases_goes_on_while_the_machine_is_suspended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "clock_gettime_ns", {time.CLOCK_BOOTTIME: 7, time.CLOCK_MONOTONIC: 3}.__getitem__)
    assert suspended_too_ns() == 7


def test_a_free_lease_never_expires() -> None:
    machine = Machine()
    lease = RobotLease(machine)
    lease.renew("the decision process", 0.2)
    lease.release("the decision process")
    machine.now_s = 10.0
    assert not lease.lost


def test_the_thread_reports_an_expired_lease_until_it_is_renewed() -> None:
    machine, told = Machine(), threading.Semaphore(0)
    lease, watch = RobotLease(machine), ThreadWatchdog()
    lease.renew("the decision process", 0.2)
    watch.begin(lease, lambda: told.release())
    try:
        machine.now_s = 0.25
        # Repeatedly: a brake command that is lost, or that a motion has overtaken, is not the last.
        assert told.acquire(timeout=PATIENCE_S)
        assert told.acquire(timeout=PATIENCE_S)
        lease.hear("the decision process")
        assert not lease.lost
    finally:
        watch.close()


def test_the_thread_continues_after_an_error_in_a_callback() -> None:
    told, lease, watch = threading.Semaphore(0), RobotLease(time.monotonic_ns), ThreadWatchdog()
    lease.renew("the decision process", 0.001)

    def raises() -> None:
        told.release()
        raise RuntimeError("the network is not there")

    watch.begin(lease, raises)
    try:
        assert told.acquire(timeout=PATIENCE_S)
        assert told.acquire(timeout=PATIENCE_S)
    finally:
        watch.close()


class Unknown:
    """A deadline that raises when read."""

    @property
    def left_s(self) -> float:
        raise RuntimeError("the driver is gone")


def test_a_deadline_that_raises_counts_as_expired_on_thread_and_loop() -> None:
    told, on_thread = threading.Semaphore(0), ThreadWatchdog()
    on_thread.begin(Unknown(), lambda: told.release())
    try:
        assert told.acquire(timeout=PATIENCE_S)
        assert told.acquire(timeout=PATIENCE_S)
    finally:
        on_thread.close()

    async def on_loop() -> None:
        told, watch = asyncio.Event(), LoopWatchdog()
        watch.begin(Unknown(), told.set)
        async with asyncio.timeout(PATIENCE_S):
            await told.wait()
        watch.close()

    asyncio.run(on_loop())


def test_a_removed_deadline_causes_no_callback() -> None:
    told, other, watch = threading.Semaphore(0), threading.Semaphore(0), ThreadWatchdog()
    ended = Unknown()
    watch.begin(ended, lambda: told.release())
    watch.begin(Unknown(), lambda: other.release())
    try:
        assert told.acquire(timeout=PATIENCE_S)
        watch.end(ended)
        while told.acquire(blocking=False):
            pass
        for _ in range(3):  # the thread has checked again since
            assert other.acquire(timeout=PATIENCE_S)
        assert not told.acquire(blocking=False)
    finally:
        watch.close()


def test_the_thread_checks_while_the_rest_of_its_process_is_blocked() -> None:
    told, lease, watch = threading.Event(), RobotLease(time.monotonic_ns), ThreadWatchdog()
    lease.renew("the decision process", 0.05)
    watch.begin(lease, told.set)
    try:
        end_s = time.monotonic() + PATIENCE_S
        while not told.is_set():  # this thread never waits: the watchdog must interrupt it
            assert time.monotonic() < end_s
    finally:
        watch.close()
