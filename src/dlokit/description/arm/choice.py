"""The arms that can be chosen by name, and files that describe others."""

import copyreg
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dlokit.description.arm.model import ArmModel
from dlokit.errors import ConfigError

ARM_NAMES = ("panda", "fr3", "ur5e")
"""Arms that are shipped."""
UR5E_FILE = Path(__file__).with_name("ur5e.toml")


@cache
def arm_model(name: str, home_q_rad: tuple[float, ...] = ()) -> ArmModel:
    """The arm of a name of `ARM_NAMES`, or of a file that `arm_file` reads.

    `home_q_rad` (J,) [rad] is its home where it is installed; empty: the arm's own. Raises `ConfigError` on an unknown
    name, an invalid file or a home that the arm does not reach, `MachineError` when the package with its model is
    missing.
    """
    from dlokit.description.arm import franka

    if home_q_rad:
        return _at_home(arm_model(name), home_q_rad)

    check_arm_name(name)
    if name == franka.PANDA.name:
        return franka.PANDA
    if name == franka.FR3.name:
        return franka.FR3
    from dlokit.description.arm.arm_file import read_arm  # reads robot descriptions with MuJoCo

    return read_arm(UR5E_FILE if name == "ur5e" else Path(name), name)


def _at_home(arm: ArmModel, home_q_rad: tuple[float, ...]) -> ArmModel:
    home, limits = np.array(home_q_rad), arm.limits
    if len(home) != len(arm.joints):
        raise ConfigError(
            f"home_deg has {len(home)} angles; the {arm.title} has {len(arm.joints)} joints: give one angle each."
        )
    out = np.flatnonzero((home < limits.position_lower_rad) | (home > limits.position_upper_rad))
    if len(out):
        joint = int(out[0])
        lower, upper = (np.degrees(each[joint]) for each in (limits.position_lower_rad, limits.position_upper_rad))
        raise ConfigError(
            f"home_deg has {np.degrees(home[joint]):.1f}° for joint {joint + 1}; the {arm.title} turns it from "
            f"{lower:.1f}° to {upper:.1f}°: correct it in the installation file."
        )
    return replace(arm, home_q_rad=home, moved_home=True)


def check_arm_name(name: str) -> None:
    """Raise `ConfigError` on a name that is neither an arm's nor a file's."""
    if name in ARM_NAMES:
        return
    if not name.endswith(".toml") or not Path(name).is_file():
        what = "there is no such file" if name.endswith(".toml") else "it is neither an arm's name nor a .toml file"
        raise ConfigError(
            f"the arm is {name}; {what}. Choose {', '.join(ARM_NAMES)}, or the file of another arm "
            "(docs/how-to/add-an-arm.md)."
        )


def _by_name(arm: ArmModel) -> tuple[Callable[..., ArmModel], tuple[Any, ...]]:
    """Pickle its name and its home only: a process that gets it reads the same arm once."""
    return (arm_model, (arm.name, tuple(arm.home_q_rad.tolist())) if arm.moved_home else (arm.name,))


copyreg.pickle(ArmModel, _by_name)
