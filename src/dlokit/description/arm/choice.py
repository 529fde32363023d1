"""The arms that can be chosen by name, and files that describe others."""

from functools import cache
from pathlib import Path

from dlokit.description.arm.model import ArmModel
from dlokit.errors import ConfigError

ARM_NAMES = ("panda", "fr3", "ur5e")
"""Arms that are shipped."""
UR5E_FILE = Path(__file__).with_name("ur5e.toml")


@cache
def arm_model(name: str) -> ArmModel:
    """The arm of a name of `ARM_NAMES`, or of a file that `arm_file` reads.

    Raises `ConfigError` on an unknown name or an invalid file, `MachineError` when the package with its model is
    missing.
    """
    from dlokit.description.arm import franka

    check_arm_name(name)
    if name == franka.PANDA.name:
        return franka.PANDA
    if name == franka.FR3.name:
        return franka.FR3
    from dlokit.description.arm.arm_file import read_arm  # reads robot descriptions with MuJoCo

    return read_arm(UR5E_FILE if name == "ur5e" else Path(name), name)


def check_arm_name(name: str) -> None:
    """Raise `ConfigError` on a name that is neither an arm's nor a file's."""
    if name in ARM_NAMES:
        return
    if not name.endswith(".toml") or not Path(name).is_file():
        what = "there is no such file" if name.endswith(".toml") else "it is neither an arm's name nor a .toml file"
        raise ConfigError(
            f"--arm is {name}; {what}. Choose {', '.join(ARM_NAMES)}, or the file of another arm "
            "(docs/how-to/add-an-arm.md)."
        )
