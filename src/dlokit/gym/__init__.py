"""Environments to learn in, for Gymnasium: importing this module registers them.

    import gymnasium
    import dlokit.gym

    env = gymnasium.make("dlokit/Shape-v0", goal="S")

`dlokit/Shape-v0` takes a grasp at a time, `dlokit/ShapeServo-v0` velocities of the tool. Both are the simulated cell
with the components of a usual run in lockstep: what an agent sees has gone through the camera and the observer.
"""

from importlib.util import find_spec

from dlokit.errors import MachineError, install_command

if find_spec("gymnasium") is None:
    raise MachineError(f"dlokit.gym needs gymnasium, which is not installed: {install_command('gym')}")

from gymnasium.envs.registration import register, registry

SHAPE, SHAPE_SERVO = "dlokit/Shape-v0", "dlokit/ShapeServo-v0"

if SHAPE not in registry:  # a module that is loaded again
    register(SHAPE, entry_point="dlokit.gym.shape:ShapeEnv")
    register(SHAPE_SERVO, entry_point="dlokit.gym.shape_servo:ShapeServoEnv")
