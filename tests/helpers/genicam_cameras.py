"""Aravis's fake GigE Vision cameras, one a process, on addresses of this computer alone."""

import fcntl
import shutil
import subprocess
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from dlokit.errors import HardwareError
from dlokit.extras.cameras.genicam import aravis, found_cameras
from dlokit.geometry import pose
from dlokit.types.image import CameraCalibration

ADDRESSES = ("127.0.0.1", "127.0.0.2")
SERIALS = ("GV01", "GV02")
SIZE_PX = (512, 512)
"""Of their pictures."""
OPTICS = CameraCalibration(
    width_px=SIZE_PX[0],
    height_px=SIZE_PX[1],
    fx_px=600.0,
    fy_px=600.0,
    cx_px=255.5,
    cy_px=255.5,
    baseline_m=0.1,
    T_world_camera=pose((0.4, 0.0, 1.2), (0.0, 1.0, 0.0, 0.0)),
)
PROGRAM = "arv-fake-gv-camera-0.8"


class FakeCameras:
    """The running cameras, each of which can be ended and started again."""

    def __init__(self) -> None:
        self._processes: dict[int, subprocess.Popen[bytes]] = {}

    def start(self, number: int) -> None:
        command = [PROGRAM, "-i", ADDRESSES[number], "-s", SERIALS[number]]
        self._processes[number] = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def kill(self, number: int) -> None:
        process = self._processes.pop(number)
        process.kill()
        process.wait()

    def end(self) -> None:
        for number in tuple(self._processes):
            self.kill(number)


def why_not() -> str:
    """What is missing for two fake cameras on this computer; empty where nothing is."""
    try:
        module: Any = aravis()
    except HardwareError as error:
        return str(error)
    if shutil.which(PROGRAM) is None:
        return f"{PROGRAM} is not installed: sudo apt install aravis-tools"
    with suppress(OSError), two_cameras():
        end_s = time.monotonic() + 5.0
        while time.monotonic() < end_s:
            if {one.serial for one in found_cameras(module)} >= set(SERIALS):
                return ""
        return f"a second fake camera needs an address of its own: sudo ip addr add {ADDRESSES[1]}/8 dev lo"
    return f"{PROGRAM} cannot be started"


@contextmanager
def two_cameras() -> Generator[FakeCameras]:
    """Two cameras, as long as the block runs; tests of other processes wait for their addresses."""
    cameras = FakeCameras()
    with (Path(tempfile.gettempdir()) / "dlokit-fake-genicam.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield from _running(cameras)


def _running(cameras: FakeCameras) -> Generator[FakeCameras]:
    try:
        for number in range(2):
            cameras.start(number)
        time.sleep(0.2)  # until they listen
        yield cameras
    finally:
        cameras.end()
