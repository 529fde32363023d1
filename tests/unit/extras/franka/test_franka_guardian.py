"""The guardian kills what is silent, and nothing else."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dlokit.extras.franka.channel import Channel, Word
from dlokit.extras.franka.guardian import ORPHAN_S, Guardian, ProcessKiller

LIMIT_S = 60.0
STREAM = 4711
SECOND = 1_000_000_000
STEP_NS = 5_000_000


class Lab:
    """A guardian with a clock, and processes that only have numbers."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.killed: list[int] = []
        self.parent = True
        self.now_ns = SECOND
        self.guardian = Guardian(channel, self.kill, lambda: self.parent)
        channel[Word.STREAM_PID] = STREAM

    def kill(self, pid: int) -> bool:
        self.killed.append(pid)
        return True

    def run(self, seconds: float, beats: bool) -> bool:
        """Look every 5 ms."""
        going = True
        for _ in range(round(seconds * SECOND / STEP_NS)):
            self.now_ns += STEP_NS
            if beats:
                self.channel[Word.STREAM_BEAT_NS] = self.now_ns
            going = self.guardian.look(self.now_ns)
        return going


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with Channel(tmp_path / "arm") as channel:
        yield Lab(channel)


def test_a_process_that_is_silent_in_a_motion_is_killed_after_its_time_and_once(lab: Lab) -> None:
    lab.channel[Word.STREAM_SILENCE_NS] = SECOND // 10
    assert lab.run(1.0, beats=True)
    assert lab.run(0.1, beats=False)
    assert lab.killed == []
    lab.run(0.005, beats=False)
    assert lab.killed == [STREAM]
    assert lab.channel[Word.KILLS] == 1
    assert lab.channel[Word.STREAM_PID] == 0
    lab.run(1.0, beats=False)
    assert lab.killed == [STREAM]


def test_a_silent_process_without_a_motion_is_left_alone(lab: Lab) -> None:
    lab.run(5.0, beats=False)
    assert lab.killed == []


def test_a_guardian_that_was_paused_itself_looks_once_more_and_only_once(lab: Lab) -> None:
    lab.channel[Word.STREAM_SILENCE_NS] = SECOND // 10
    lab.run(0.1, beats=True)
    lab.now_ns += SECOND  # the whole machine was suspended
    lab.guardian.look(lab.now_ns)
    assert lab.killed == []
    lab.now_ns += SECOND
    lab.guardian.look(lab.now_ns)
    assert lab.killed == [STREAM]


def test_after_the_drivers_death_the_streaming_process_gets_its_time_to_brake(lab: Lab) -> None:
    lab.parent = False
    assert lab.run(ORPHAN_S, beats=True)
    assert lab.killed == []
    assert not lab.run(0.01, beats=True)
    assert lab.killed[0] == STREAM


def test_it_ends_at_the_order_but_not_before_the_arm_is_at_rest(lab: Lab) -> None:
    lab.channel[Word.STREAM_SILENCE_NS] = SECOND // 10
    lab.channel[Word.CLOSE] = 1
    assert lab.run(0.5, beats=True)
    lab.channel[Word.STREAM_SILENCE_NS] = 0
    assert not lab.run(0.005, beats=True)


def test_its_heartbeat_goes_on(lab: Lab) -> None:
    lab.run(0.1, beats=False)
    assert lab.channel[Word.GUARD_BEAT_NS] == lab.now_ns


@pytest.mark.live
def test_a_process_is_killed_by_its_handle_and_a_number_that_is_free_again_is_not() -> None:
    child = subprocess.Popen((sys.executable, "-c", "import time; time.sleep(600)"))
    killer = ProcessKiller()
    killer.see(child.pid)
    assert killer(child.pid)
    assert child.wait(LIMIT_S) == -signal.SIGKILL
    assert not killer(child.pid)  # collected: another process could have the number
    killer.see(0)
    assert not killer(0)


@pytest.mark.live
def test_the_program_kills_a_frozen_child_and_ends_with_its_parent(tmp_path: Path) -> None:
    child = subprocess.Popen((sys.executable, "-c", "import time; time.sleep(600)"))
    with Channel(tmp_path / "arm") as channel:
        channel[Word.STREAM_PID] = child.pid
        channel[Word.STREAM_BEAT_NS] = time.monotonic_ns()
        guardian = subprocess.Popen((sys.executable, "-m", "dlokit.extras.franka.guardian", str(tmp_path / "arm")))
        try:
            os.kill(child.pid, signal.SIGSTOP)
            channel[Word.STREAM_SILENCE_NS] = SECOND // 10
            assert child.wait(LIMIT_S) == -signal.SIGKILL
            channel[Word.CLOSE] = 1
            assert guardian.wait(LIMIT_S) == 0
        finally:
            child.kill()
            guardian.kill()


@pytest.mark.live
def test_it_loads_nothing_beyond_the_standard_library() -> None:
    loads = (
        "import sys; import dlokit.extras.franka.guardian; "
        "print([name for name in ('numpy', 'msgspec', 'asyncio', 'franky') if name in sys.modules])"
    )
    assert subprocess.run((sys.executable, "-c", loads), capture_output=True, text=True).stdout == "[]\n"


@pytest.mark.live
def test_the_streaming_process_loads_nothing_heavy() -> None:
    loads = (
        "import sys; import dlokit.extras.franka.stream; "
        "print([name for name in ('scipy', 'mujoco', 'numba', 'asyncio', 'zenoh', 'msgspec') if name in sys.modules])"
    )
    assert subprocess.run((sys.executable, "-c", loads), capture_output=True, text=True).stdout == "[]\n"
