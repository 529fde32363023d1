"""The driver of the Franka as a choice of the configuration."""

from dataclasses import replace

import pytest

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.description.arm.franka import FR3, PANDA
from dlokit.description.arm.mounts import INSTANCES, ArmMount
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.franka.driver import FrankaRobot, FrankaRobotConfig
from dlokit.extras.franka.link import wrong_version
from dlokit.extras.franka.panda_link import word_of
from dlokit.extras.franka.reflexes import Reaction, named, reaction
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.strategies import DRIVERS

FIRST = ArmMount(model=FR3)


def built(mount: ArmMount) -> Robot:
    port = Port(MemoryTransport(), LoopClock(), InlineCompute(), owner="driver", publishes=())
    return FrankaRobotConfig().build(port, mount, ThreadPulse())


def test_it_is_chosen_by_its_name_and_moves_a_real_arm() -> None:
    assert DRIVERS.installed()["franka"] is FrankaRobotConfig
    assert FrankaRobotConfig.is_real
    assert not FrankaRobotConfig.in_cell
    assert isinstance(built(FIRST), FrankaRobot)


def test_another_arm_than_frankas_is_refused() -> None:
    with pytest.raises(ConfigError, match="add --arm fr3 or --arm panda"):
        built(replace(FIRST, model=replace(FR3, name="mine")))


def test_a_panda_is_taken_but_its_library_sets_no_load() -> None:
    assert isinstance(built(replace(FIRST, model=PANDA)), FrankaRobot)
    port = Port(MemoryTransport(), LoopClock(), InlineCompute(), owner="driver", publishes=())
    with pytest.raises(ConfigError, match=r"load-kg cannot be set on a Panda.* end effector in Desk"):
        FrankaRobotConfig(load_kg=0.1).build(port, replace(FIRST, model=PANDA), ThreadPulse())


def test_the_errors_of_a_panda_are_read_by_their_names_and_an_unknown_one_needs_a_person() -> None:
    assert named(word_of(["tau_J_range_violation"])) == ("tau_j_range_violation",)
    assert named(word_of(["cartesian_position_motion_generator_invalid_frame_flag"])) == (
        "cartesian_position_motion_generator_invalid_frame",
    )
    assert reaction(word_of(["communication_constraints_violation", "of_another_version"])) is Reaction.PERSON
    assert word_of([]) == 0


def test_a_second_arm_at_the_same_address_is_refused() -> None:
    with pytest.raises(ConfigError, match="leave --arms at 1"):
        built(replace(FIRST, instance=INSTANCES[1]))


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [("collision_force_n", 100.0, "5 to 60"), ("collision_torque_nm", 1.0, "5 to 40"), ("load_kg", -0.1, "0 to 2")],
)
def test_thresholds_and_load_have_bounds(name: str, value: float, allowed: str) -> None:
    with pytest.raises(ConfigError, match=f"must be {allowed}"):
        replace(FrankaRobotConfig(), **{name: value})


def test_it_says_that_it_is_not_connected() -> None:
    robot = built(FIRST)
    robot.brake()  # without effect, and without an error: any thread may call it at any time
    with pytest.raises(HardwareError, match="not connected"):
        robot.state()


def test_another_firmware_is_named_with_the_wheel_that_speaks_it() -> None:
    said = wrong_version("libfranka: Incompatible library version (server version: 5, library version: 10).")
    assert "server version: 5, library version: 10" in said
    assert "--extra-index-url https://timschneider42.github.io/franky/whl/by-robot-server-version/<version>/" in said
