"""Messages of a first run during compilation, and the commands that the demo suggests."""

import io
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numba
import numpy as np
import pytest
from rich.console import Console

from dlokit.app.commands import parse
from dlokit.app.console import compile_progress
from dlokit.app.shape.demo import NEXT
from dlokit.description.arm.mounts import WorkspaceBox
from dlokit.description.installation import Installation, InstalledArm
from dlokit.errors import ConfigError, MachineError
from dlokit.extras.cameras.genicam import GenicamConfig
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.extras.ros2.camera import Ros2CameraConfig
from dlokit.functional.cameras.base import CameraConfig
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.cameras.simulated import SimulatedD435Config
from dlokit.functional.cell.depth_rendering import depth_camera
from dlokit.system.config import RunConfig
from dlokit.system.configuration import preflight
from dlokit.system.configuration.installation_checks import check_installation

COMPILE: Any = numba.njit  # the type stub has only decorators


def said_while(work: Callable[[], object]) -> list[str]:
    printed = io.StringIO()
    with compile_progress(Console(file=printed, width=200), "the observer"):
        work()
    return printed.getvalue().splitlines()


def test_compiling_is_announced_once_and_counted() -> None:
    inner: Any = COMPILE(lambda value: value + 1)
    outer: Any = COMPILE(lambda value: inner(value) * 2)
    begun, done = said_while(lambda: outer(1))
    assert "compiling" in begun
    assert "2 functions" in done


def test_compiled_code_is_not_announced() -> None:
    kernel: Any = COMPILE(lambda value: value + 1)
    kernel(1)
    assert said_while(lambda: kernel(2)) == []


def test_the_demo_names_three_commands_that_dlokit_understands() -> None:
    assert len(NEXT) == 3
    for command in NEXT:
        parse(shlex.split(command)[1:])


DEEP = WorkspaceBox(lower_m=(-1.0, -1.0, -1.0))


@pytest.mark.parametrize(
    ("arm", "named"),
    [
        (InstalledArm(position_m=(0.0, 0.0, -0.8)), "outside its workspace"),
        (
            InstalledArm(position_m=(0.0, 0.0, -0.8), workspace=DEEP),
            "above the table",
        ),
    ],
)
def test_an_arm_that_could_not_stand_at_home_is_refused_before_the_start(arm: InstalledArm, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        check_installation(RunConfig(installation=Installation(arms=(arm,))))


def calibration_of(serial: str, folder: Path) -> str:
    """A file with the calibration of a camera that takes pictures of the depth camera's size."""
    file = folder / f"{serial}.toml"
    write_calibration(file, msgspec.structs.replace(depth_camera(), serial=serial))
    return str(file)


def test_a_calibration_is_compared_with_the_camera_of_the_run_before_the_start(tmp_path: Path) -> None:
    own = depth_camera().serial
    run = RunConfig(headless=True, camera=SimulatedD435Config())
    preflight.check_before_start(replace(run, calibration=calibration_of(own, tmp_path)))
    other = calibration_of("simulated", tmp_path)
    with pytest.raises(ConfigError, match=f"'simulated', this one is '{own}'"):
        preflight.check_before_start(replace(run, calibration=other))
    with pytest.raises(ConfigError, match=f"'{own}', this one is 'simulated'"):
        preflight.check_before_start(RunConfig(headless=True, calibration=calibration_of(own, tmp_path)))


def test_recorded_pictures_are_compared_with_a_calibration_before_the_start(tmp_path: Path) -> None:
    camera = depth_camera()
    write_calibration(tmp_path / "calibration.toml", camera)
    for name, dtype in (("colour", np.uint8), ("depth", np.uint16)):
        cv2.imwrite(str(tmp_path / f"{name}_0.png"), np.zeros((camera.height_px, camera.width_px), dtype))
    recorded = RecordedCameraConfig(path=str(tmp_path))
    run = RunConfig(headless=True, dry_run=True, camera=recorded, calibration=calibration_of(camera.serial, tmp_path))
    preflight.check_before_start(run)
    with pytest.raises(ConfigError, match=f"'other', this one is '{camera.serial}'"):
        preflight.check_before_start(replace(run, calibration=calibration_of("other", tmp_path)))


def test_a_device_whose_serial_is_set_is_compared_before_the_start(tmp_path: Path) -> None:
    run = RunConfig(
        runtime="live", headless=True, dry_run=True, camera=RealSenseConfig(serial="0123"),
        calibration=calibration_of("0456", tmp_path),
    )  # fmt: skip
    with pytest.raises(ConfigError, match=r"of the camera '0456', and --camera realsense is set to '0123'"):
        preflight.check_before_start(run)
    preflight.check_before_start(replace(run, calibration=calibration_of("0123", tmp_path)))


@pytest.mark.parametrize(
    "camera",
    [
        GenicamConfig(left="192.168.1.10", right="192.168.1.11"),  # an address is no serial
        Ros2CameraConfig(colour="/left/image_rect", right="/right/image_rect"),  # nor is a topic
    ],
)
def test_a_camera_that_is_not_named_by_its_serial_is_compared_by_its_pictures(
    camera: CameraConfig, tmp_path: Path
) -> None:
    run = RunConfig(runtime="live", headless=True, dry_run=True, camera=camera)
    preflight.check_calibration(replace(run, calibration=calibration_of("0456", tmp_path)))


def test_a_live_run_is_refused_before_its_start_where_no_memory_is_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise MachineError("/dev/shm cannot be written")

    monkeypatch.setattr(preflight, "check_shared_memory", refuse)
    with pytest.raises(MachineError, match="/dev/shm cannot be written"):
        preflight.check_before_start(RunConfig(runtime="live", headless=True))
    preflight.check_before_start(RunConfig(headless=True))  # lockstep is one process
