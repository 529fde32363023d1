import asyncio
import subprocess
import sys
from collections.abc import Iterator

import pytest
from dlokit_lab_arm.driver import LabArm, LabArmConfig

from dlokit.communication.timing.pulse import loop_pulse
from dlokit.description.arm.mounts import ArmMount, arm_model
from dlokit.errors import HardwareError
from dlokit.functional.robots.strategies import DRIVERS
from dlokit.testing import check_robot


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """The port of a simulated controller."""
    command = [sys.executable, "-m", "dlokit_lab_arm.controller", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as controller:
        assert controller.stdout is not None
        yield int(controller.stdout.readline().split()[-1])
        controller.terminate()


def test_it_keeps_to_the_protocol(port: int) -> None:
    check_robot(LabArmConfig(port=port).build, ArmMount(model=arm_model("panda")))


def test_it_is_found_by_its_entry_point() -> None:
    assert DRIVERS.installed()["lab-arm"] is LabArmConfig


async def opened(config: LabArmConfig, arm: str) -> None:
    async with LabArm(config, ArmMount(model=arm_model(arm)), loop_pulse):
        pass


def test_a_controller_that_does_not_answer_is_named() -> None:
    with pytest.raises(HardwareError, match=r"the controller at 127\.0\.0\.1:1 does not answer"):
        asyncio.run(opened(LabArmConfig(port=1), "panda"))


def test_an_arm_with_other_joints_than_its_model_is_refused(port: int) -> None:
    pytest.importorskip("airo_models")  # has the description of the UR5e
    with pytest.raises(HardwareError, match="has 7 joints, Universal Robots UR5e with a Robotiq Hand-E has 6"):
        asyncio.run(opened(LabArmConfig(port=port), "ur5e"))
