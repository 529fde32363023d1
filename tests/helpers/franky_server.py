"""franky-sim, a simulator of the FR3's protocol, in a process of its own that also writes down where its arm was.

Run as a program it is that process: ``franky_server.py ADDRESS LOG OBSTACLE_M TOOL_M``.
"""

import mmap
import os
import signal
import struct
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np

from dlokit.description.arm.franka import FR3
from dlokit.types.arrays import Float64Array

_ROWS = 65_536
_ROW = struct.Struct("=qd7d7dd")
"""Monotonic time [ns], simulated time [s], angles, speeds, finger width."""
_HEAD = 64
_STARTS_S = 60.0


class Moment(NamedTuple):
    """The true arm at one time."""

    now_ns: int
    simulated_s: float
    q: Float64Array
    dq: Float64Array
    width_m: float


def why_not() -> str:
    """Why franky-sim cannot run here; empty where it can."""
    missing = [name for name in ("franky", "franky_sim", "pinocchio") if find_spec(name) is None]
    return f"{', '.join(missing)} not installed: make test-peers" if missing else ""


class FrankyServer:
    """The simulator at an address of its own; a context manager."""

    def __init__(
        self, folder: Path, address: str = "127.0.31.1", *, obstacle_m: float = 0.0, tool_m: float = 0.1034
    ) -> None:
        """A box of the thickness `obstacle_m` between the fingers, where that is not 0.

        `tool_m` is from the flange to the tool centre point, as chosen in Desk.
        """
        self.address = address
        self._log = folder / "franky_server.log"
        self._arguments = (str(obstacle_m), str(tool_m))
        self._process: subprocess.Popen[bytes] | None = None
        self._map: mmap.mmap | None = None

    def __enter__(self) -> Self:
        """Start it; returns when it answers."""
        with self._log.open("wb") as file:
            file.truncate(_HEAD + _ROWS * _ROW.size)
        with self._log.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self._process = subprocess.Popen(
            (sys.executable, __file__, self.address, str(self._log), *self._arguments),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        deadline_s = time.monotonic() + _STARTS_S
        while self._count < 200:
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                self.kill()
                raise RuntimeError("franky-sim did not start")
            time.sleep(0.05)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        self.kill()

    def kill(self) -> None:
        """As a control box that is switched off."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()

    def freeze(self) -> None:
        """As a network that is cut."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """As a network that is back."""
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    @property
    def _count(self) -> int:
        assert self._map is not None
        return struct.unpack_from("q", self._map, 0)[0]

    def now(self) -> Moment:
        """Where the arm is."""
        return self._moment(self._count - 1)

    def since(self, now_ns: int) -> list[Moment]:
        """Where it was after a time, oldest first."""
        rows: list[Moment] = []
        index = self._count - 1
        while index >= 0:
            moment = self._moment(index)
            if moment.now_ns < now_ns:
                break
            rows.append(moment)
            index -= 1
        return rows[::-1]

    def _moment(self, index: int) -> Moment:
        assert self._map is not None
        row = _ROW.unpack_from(self._map, _HEAD + (index % _ROWS) * _ROW.size)
        return Moment(row[0], row[1], np.array(row[2:9]), np.array(row[9:16]), row[16])


def standing_after_s(moments: list[Moment], since_ns: int, speed_rad_s: float = 0.02) -> float:
    """When the arm had come to rest for good, after a time [s of the machine's clock]; inf if it has not.

    Speeds are differences of the angles over 20 ms of the simulator: where its own controller holds the last joint,
    that swings by 1e-4 rad from step to step, which no real joint does.
    """
    span = 20
    q, seconds = np.array([moment.q for moment in moments]), np.array([moment.simulated_s for moment in moments])
    speed = np.abs(q[span:] - q[:-span]).max(axis=1) / (seconds[span:] - seconds[:-span])
    moving = np.flatnonzero(speed > speed_rad_s)
    if not len(moving):
        return 0.0
    if moving[-1] == len(speed) - 1:
        return float("inf")
    return (moments[int(moving[-1]) + span // 2].now_ns - since_ns) / 1e9


def _serve(address: str, log: str, obstacle_m: float, tool_m: float) -> None:
    import xml.etree.ElementTree as ElementTree

    from franky_sim import RobotParameters, SimulationServer  # pyright: ignore
    from franky_sim.mujoco_simulator import MujocoSimulator  # pyright: ignore

    with Path(log).open("r+b") as file:
        shared = mmap.mmap(file.fileno(), 0)
    simulator: Any = MujocoSimulator()
    count = 0
    with simulator as sim:
        parameters: Any = RobotParameters(ee_tcp_xyz=(0.0, 0.0, tool_m))
        robot = sim.add_robot(initial_q=FR3.home_q_rad.tolist(), initial_hand_width=0.078, robot_parameters=parameters)
        if obstacle_m:
            # In the air, fixed, where the fingers close when the arm is at home.
            body = ElementTree.SubElement(sim.worldbody, "body", name="obstacle", pos="0.278 0 0.455")
            size = f"0.01 {obstacle_m / 2} 0.01"
            ElementTree.SubElement(body, "geom", type="box", size=size)
        parent = os.getppid()

        def note(_: Any) -> None:
            nonlocal count
            state = robot.inner_state
            row = _ROW.pack(time.monotonic_ns(), count * 1e-3, *state.q, *state.dq, robot.hand_width)
            at = _HEAD + (count % _ROWS) * _ROW.size
            shared[at : at + _ROW.size] = row
            count += 1
            struct.pack_into("q", shared, 0, count)
            if count % 500 == 0 and os.getppid() != parent:
                os._exit(0)

        sim.register_post_step_callback(note)
        with SimulationServer(sim, hostname_candidates=[address]) as server:
            server.run_forever()


if __name__ == "__main__":
    _serve(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]))
