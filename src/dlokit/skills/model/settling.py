"""What becomes of a rod that is laid down and let go: friction may not hold it, and elasticity straightens it.

A rod on a level table is held where friction balances its elastic forces, which depends on one figure alone, EI / (μ w)
with w the weight per length. A rod that yields has kept, where it lies, what it was bent beyond its yield curvature.
"""

import numpy as np

from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.quick_push import NO_FINGERS
from dlokit.skills.model.quick_rod import play_motion
from dlokit.skills.model.quick_rollout import SINK_M, QuickRod
from dlokit.skills.model.rod import fit_length
from dlokit.types.arrays import Float64Array

_AS_MODELLED = QuickRod()
_NO_TOOL, _NO_PADS = np.zeros((0, 4)), np.zeros((0, 3))


def settle(config: ModelConfig, nodes_world: Float64Array, rod: QuickRod = _AS_MODELLED) -> Float64Array:
    """Where a rod laid down as `nodes_world` (K, 3) [m] and let go comes to rest, (M, 3) [m].

    It is taken to have been straight before it was laid down, and does not collide with itself.
    """
    nodes = fit_length(config, nodes_world)
    nodes[:, 2] = config.radius_m - SINK_M
    end = np.empty_like(nodes)
    step_s = config.settle.timestep_s
    steps = round(config.settle.duration_s / step_s)
    play_motion(nodes, rod.numbers(config, config.nodes), step_s, steps, _NO_TOOL, _NO_PADS, NO_FINGERS, end)
    end[:, 2] = np.maximum(end[:, 2], config.radius_m)
    return end
