"""The arms that can be chosen by name."""

from dlokit.description.arm.franka import FR3, PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.errors import ConfigError

_ARMS = {arm.name: arm for arm in (PANDA, FR3)}


def arm_model(name: str) -> ArmModel:
    """The arm of a name. Raises `ConfigError` on an unknown name."""
    if name not in _ARMS:
        raise ConfigError(f"--arm is {name}; there is no such arm. Choose {' or '.join(_ARMS)}.")
    return _ARMS[name]
