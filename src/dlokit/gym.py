"""`dlokit.gym`: environments to learn in, for Gymnasium: importing it registers them.

    import gymnasium
    import dlokit.gym

    env = gymnasium.make("dlokit/Shape-v0", goal="S")

`dlokit/Shape-v0` takes a grasp at a time, `dlokit/ShapeServo-v0` velocities of the tool. Both are the simulated cell
with the components of a usual run in lockstep: what an agent sees has gone through the camera and the observer.
"""

import sys

from dlokit.extras.gym import SHAPE, SHAPE_SERVO, demonstrations, policy_planner, shape
from dlokit.extras.gym.demonstrations import Demonstration, read_demonstrations, write_demonstrations
from dlokit.extras.gym.policy_planner import PolicyPlanner
from dlokit.extras.gym.shape import ShapeEnv

__all__ = [
    "SHAPE",
    "SHAPE_SERVO",
    "Demonstration",
    "PolicyPlanner",
    "ShapeEnv",
    "read_demonstrations",
    "write_demonstrations",
]

# Programs from before the annexes import these by `dlokit.gym.demonstrations` and so on.
for _name, _module in {"demonstrations": demonstrations, "policy_planner": policy_planner, "shape": shape}.items():
    sys.modules[f"dlokit.gym.{_name}"] = _module
