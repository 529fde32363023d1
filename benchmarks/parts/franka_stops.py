"""How soon a Franka stands after a process fails in mid-motion, measured in the simulator's own log."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from franky_server import FrankyServer, standing_after_s

from dlokit.extras.franka.channel import Channel, Latch, StreamPhase, Word, path_of
from parts import franka_commander

_MOVING_RAD_S = 0.5
"""A fault is injected when a joint is faster than this."""
_WATCHED_S = 1.6
"""Time for which the arm is watched after a fault [s]: longer than the bars, shorter than the pause that ends it."""
_BEGINS_S = 30.0


@dataclass(frozen=True)
class Stopped:
    """What happened after a fault."""

    braking_s: float
    """Until the streaming process braked, or was gone [s of the machine's clock]."""
    standing_s: float
    """Until the simulated arm had come to rest for good [s of the machine's clock]."""
    simulated_s: float
    """The same by the simulator's clock [s], which is slower on a busy machine."""
    speed_rad_s: float
    """Speed of the fastest joint at the fault."""
    load: float
    """Load of the machine, the average of a minute."""


def _signal(number: signal.Signals, name: str) -> Callable[[dict[str, int], Channel], None]:
    return lambda pids, channel: os.kill(pids[name], number)


def _press(pids: dict[str, int], channel: Channel) -> None:
    channel[Word.LATCH] = Latch.PERSON


FAULTS: dict[str, Callable[[dict[str, int], Channel], None]] = {
    "commander killed": _signal(signal.SIGKILL, "commander"),
    "commander frozen": _signal(signal.SIGSTOP, "commander"),
    "streaming killed": _signal(signal.SIGKILL, "stream"),
    "streaming frozen": _signal(signal.SIGSTOP, "stream"),
    "interpreter held for 2 s": _signal(franka_commander.HANG, "stream"),
    "guardian killed": _signal(signal.SIGKILL, "guardian"),
    "guardian frozen": _signal(signal.SIGSTOP, "guardian"),
    "stop": _press,
}


def stopped_after(fault: str, server: FrankyServer, folder: Path, pace: float) -> Stopped:
    """Move the arm of the simulator, let the fault happen, and watch."""
    pids: dict[str, int] = {}
    with subprocess.Popen(
        (sys.executable, franka_commander.__file__, server.address, str(folder), str(pace)),
        stdout=subprocess.PIPE,
        env=franka_commander.hanging_environment(folder),
    ) as program:
        assert program.stdout is not None
        try:
            pids = {**json.loads(program.stdout.readline()), "commander": program.pid}
            return _in_motion(fault, server, folder, pids)
        finally:
            for pid in pids.values():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            program.kill()


def _in_motion(fault: str, server: FrankyServer, folder: Path, pids: dict[str, int]) -> Stopped:
    with Channel(path_of(server.address, folder)) as channel:
        try:
            return _watched(fault, server, channel, pids)
        finally:
            channel[Word.LATCH] = Latch.NONE


def _watched(fault: str, server: FrankyServer, channel: Channel, pids: dict[str, int]) -> Stopped:
    deadline_s = time.monotonic() + _BEGINS_S
    while (speed := float(np.abs(server.now().dq).max())) < _MOVING_RAD_S:
        if time.monotonic() > deadline_s:
            raise RuntimeError("the arm did not begin to move")
        time.sleep(0.001)
    began_ns = time.monotonic_ns()
    FAULTS[fault](pids, channel)
    braked_ns = 0
    while time.monotonic_ns() - began_ns < _WATCHED_S * 1e9:
        state = channel.read_state()
        brakes = state is None or state.phase != StreamPhase.MOVING or channel[Word.STREAM_PID] == 0
        if not braked_ns and (brakes or fault == "streaming killed"):
            braked_ns = time.monotonic_ns()
        time.sleep(0.001)
    moments = server.since(began_ns)
    simulated_s = standing_after_s(
        [each._replace(now_ns=round(each.simulated_s * 1e9)) for each in moments], round(moments[0].simulated_s * 1e9)
    )
    return Stopped(
        braking_s=(braked_ns - began_ns) / 1e9 if braked_ns else float("inf"),
        standing_s=standing_after_s(moments, began_ns),
        simulated_s=simulated_s,
        speed_rad_s=speed,
        load=os.getloadavg()[0],
    )
