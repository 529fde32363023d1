"""The arms that can be chosen by name or by file, and the poses of their bases."""

import copyreg
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dlokit.description.arm.franka import FR3, PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.errors import ConfigError
from dlokit.ranges import check_ranges
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT

SECOND = "second"
"""Name of the second arm."""
ROBOTS = (FIRST_ROBOT, SECOND)
"""Names of the arms, unless the installation names them; a run uses the first ones."""
INSTANCES = ("", SECOND)
"""Their addresses, for `Skill.at` and `Topic.at`: instances of the component `robot`, independent of the names."""


@dataclass(frozen=True, kw_only=True)
class WorkspaceBox:
    """The box that a tool centre point never leaves, in the world."""

    lower_m: tuple[float, float, float] = (-0.3, -0.9, 0.0)
    """Corner with the smallest x, y and z [m]."""
    upper_m: tuple[float, float, float] = (1.34, 0.9, 1.2)
    """The opposite corner [m]; by default the box contains the reach of one arm, or of two opposite arms, in front."""

    def __post_init__(self) -> None:
        check_ranges(self, "workspace")
        if not all(a < b for a, b in zip(self.lower_m, self.upper_m, strict=True)):
            raise ConfigError(
                f"the workspace of an arm has lower_m {self.lower_m} and upper_m {self.upper_m}; the first must be "
                "below the second in x, y and z."
            )


WORKSPACE = WorkspaceBox()


@dataclass(frozen=True, kw_only=True)
class ArmMount:
    """An arm by its name, and the pose of its base in the world."""

    robot: str = FIRST_ROBOT
    """Its name, which messages carry."""
    instance: str = ""
    """Its address, one of `INSTANCES`."""
    model: ArmModel = PANDA
    T_world_base: Pose | None = None
    """None: at the world's origin."""
    workspace: WorkspaceBox = WORKSPACE

    @property
    def place_m(self) -> tuple[float, float]:
        """Position of its base on the table (x, y) [m]."""
        if self.T_world_base is None:
            return (0.0, 0.0)
        x, y = self.T_world_base.position_m[:2].tolist()
        return (x, y)


FIRST_ALONE = (ArmMount(),)
"""A Panda at the world's origin."""


_FRANKAS = {arm.name: arm for arm in (PANDA, FR3)}
ARM_NAMES = (*_FRANKAS, "ur5e")
"""The arms that dlokit includes."""
UR5E_FILE = Path(__file__).with_name("ur5e.toml")


@cache
def arm_model(name: str, home_q_rad: tuple[float, ...] = ()) -> ArmModel:
    """The arm of a name of `ARM_NAMES`, or of a file that `arm_file` reads.

    `home_q_rad` (J,) [rad] is its home where it is installed; empty: the arm's own. Raises `ConfigError` on an unknown
    name, an invalid file or a home that the arm does not reach, `MachineError` when the package with its model is
    missing.
    """
    if home_q_rad:
        return _at_home(arm_model(name), home_q_rad)
    check_arm_name(name)
    if name in _FRANKAS:
        return _FRANKAS[name]
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
    """Raise `ConfigError` for a name that is not an arm's or a file's."""
    if name in ARM_NAMES:
        return
    if not name.endswith(".toml") or not Path(name).is_file():
        what = "there is no such file" if name.endswith(".toml") else "it is neither an arm's name nor a .toml file"
        raise ConfigError(
            f"the arm is {name}; {what}. Choose {', '.join(ARM_NAMES)}, or the file of another arm "
            "(docs/how-to/add-an-arm.md)."
        )


def _by_name(arm: ArmModel) -> tuple[Callable[..., ArmModel], tuple[Any, ...]]:
    """Pickle its name and its home only: the receiving process reads the same arm once."""
    return (arm_model, (arm.name, tuple(arm.home_q_rad.tolist())) if arm.moved_home else (arm.name,))


copyreg.pickle(ArmModel, _by_name)
