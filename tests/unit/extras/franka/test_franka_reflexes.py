"""Errors of the arm by name, and what follows each."""

import importlib.util
from typing import Any

import pytest

from dlokit.extras.franka.channel import Latch
from dlokit.extras.franka.reflexes import NAMES, REFLEXES, ArmMode, Reaction, latch_of, named, reaction


def word(*names: str) -> int:
    return sum(1 << NAMES.index(name) for name in names)


def test_an_error_word_keeps_its_names() -> None:
    assert named(word("joint_reflex", "tau_j_range_violation")) == ("joint_reflex", "tau_j_range_violation")
    assert named(0) == ()
    assert len(NAMES) <= 63  # bits of a signed word


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("communication_constraints_violation",), Reaction.RECOVER),
        (("communication_constraints_violation", "controller_torque_discontinuity"), Reaction.RECOVER),
        (("communication_constraints_violation", "joint_velocity_violation"), Reaction.FAULT),
        (("communication_constraints_violation", "cartesian_reflex"), Reaction.PERSON),
        ((), Reaction.FAULT),
    ],
)
def test_of_several_errors_the_most_careful_reaction_counts(names: tuple[str, ...], expected: Reaction) -> None:
    assert reaction(word(*names)) is expected


@pytest.mark.parametrize(
    ("mode", "names", "expected"),
    [
        (ArmMode.REFLEX, ("joint_reflex",), Latch.COLLISION),
        (ArmMode.REFLEX, ("self_collision_avoidance_violation",), Latch.ARM_ERROR),
        (ArmMode.USER_STOPPED, (), Latch.USER_STOP),
        (ArmMode.GUIDING, (), Latch.GUIDING),
        (ArmMode.REFLEX, ("communication_constraints_violation",), Latch.NONE),
        (ArmMode.REFLEX, ("tau_j_range_violation",), Latch.NONE),
        (ArmMode.IDLE, (), Latch.NONE),
    ],
)
def test_collision_user_stop_and_guiding_latch(mode: ArmMode, names: tuple[str, ...], expected: Latch) -> None:
    assert latch_of(mode, word(*names)) is expected


@pytest.mark.skipif(importlib.util.find_spec("franky") is None, reason="franky-control is not installed")
def test_every_error_and_mode_of_the_library_is_in_the_tables() -> None:
    franky: Any = importlib.import_module("franky")
    flags = {name for name in dir(franky.Errors) if isinstance(getattr(franky.Errors, name), property)}
    assert flags == set(REFLEXES)
    assert {name.replace("_", "").lower(): int(mode) for name, mode in ArmMode.__members__.items()} == {
        name.lower(): int(mode) for name, mode in franky.RobotMode.__members__.items()
    }
