"""What an action does to the rod, predicted: friction and gravity on, the grasped nodes follow the tool."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dlokit import geometry
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.grip import take_hold
from dlokit.skills.model.quick_rollout import predict_push
from dlokit.skills.model.rod import RodModel, fit_length
from dlokit.types.action import Action, Push
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

_STRIDE = 4  # physics steps between two updates of the tool's pose


def predict(config: ModelConfig, nodes_world: Float64Array, action: Action) -> Float64Array:
    """The shape (M, 3) [m] some time after `action` was done to a rod at `nodes_world` (M, 3).

    It is held at the grasp; a push, which holds nothing, is played in the quick rod, which meets closed fingers.
    """
    if isinstance(action, Push):
        return predict_push(config, nodes_world, action)
    rod = rod_on_table(config, nodes_world)
    poses = (action.grasp.T_world_tcp, *action.path)
    grip = take_hold(rod.nodes_world, action.grasp.node, poses[0])
    targets, gains = rod.nodes_world, np.zeros((config.nodes, 3))
    gains[grip.nodes] = grip.gains_n_m(config.rollout.grip_stiffness_n_m)
    period_s = _STRIDE * config.rollout.timestep_s
    for tool in along(poses, action.velocity.speed_m_s, period_s):
        targets[grip.nodes] = grip.targets_world(tool)
        rod.pull(targets, gains)
        rod.step(_STRIDE)
    rod.let_go()
    rod.step(math.ceil(config.rollout.release_s / config.rollout.timestep_s))
    return rod.nodes_world


def along(poses: tuple[Pose, ...], speed_m_s: float, period_s: float) -> Iterator[Pose]:
    """Poses on a polyline, one every `period_s` at constant speed, the last one included."""
    for start, end in itertools.pairwise(poses):
        turns = Rotation.from_quat(np.stack((start.wxyz, end.wxyz)), scalar_first=True)
        # A turn on the spot takes time as well: a radian counts as 10 cm.
        travel_m = (
            float(np.linalg.norm(end.position_m - start.position_m)) + 0.1 * (turns[0].inv() * turns[1]).magnitude()
        )
        count = max(1, math.ceil(travel_m / (speed_m_s * period_s)))
        slerp = Slerp([0.0, 1.0], turns)
        for k in range(1, count + 1):
            fraction = k / count
            yield geometry.pose(
                start.position_m + fraction * (end.position_m - start.position_m),
                slerp(fraction).as_quat(scalar_first=True),
            )


def rod_on_table(config: ModelConfig, nodes_world: Float64Array) -> RodModel:
    """A rod lying as `nodes_world` (K, 3) [m], brought to its length, with gravity and friction on."""
    rod = RodModel(config, timestep_s=config.rollout.timestep_s)
    nodes = fit_length(config, nodes_world)
    nodes[:, 2] = np.maximum(nodes[:, 2], config.radius_m)
    rod.place(nodes)
    rod.on_table(True)
    return rod
