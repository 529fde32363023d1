"""Environments to learn in, for Gymnasium: importing this package registers them. Users know it as `dlokit.gym`."""

from importlib.util import find_spec

from dlokit.errors import lacks_extra

if find_spec("gymnasium") is None:
    raise lacks_extra("dlokit.gym", "gym")

from gymnasium.envs.registration import register, registry

SHAPE, SHAPE_SERVO = "dlokit/Shape-v0", "dlokit/ShapeServo-v0"

if SHAPE not in registry:  # a module that is loaded again
    register(SHAPE, entry_point="dlokit.extras.gym.shape:ShapeEnv")
    register(SHAPE_SERVO, entry_point="dlokit.extras.gym.shape_servo:ShapeServoEnv")
