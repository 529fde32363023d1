"""How well each rod of a grid explains an action: the action is played through on all of them."""

import math
from dataclasses import dataclass, replace

import numpy as np

from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.identification.experience import Experience
from dlokit.skills.model.quick_rollout import QuickRod, play
from dlokit.types.arrays import Float64Array

FRICTION_LOG = np.log(2.0) * np.linspace(-1.0, 1.0, 5)
"""Logarithms of the friction that are tried, over the model's: half to twice of it."""
STIFFNESS_LOG = np.log(2.0) * np.arange(-2.0, 10.0)
"""Logarithms of the bending stiffness that are tried, over the model's: a quarter to 512 times of it."""
YIELDS_1_M = (math.inf, 3.0, 1.0)
"""Yield curvatures that are tried [1/m]: a DLO that springs back always, and two that take a set."""
_TIMESTEP_S = 0.005
_REST_S = 1.0
_SEEN_M = 0.004  # the state's own error
_MODEL_SHARE = 0.08  # error of the rod of planning, as a share of how far a node was moved
_LOW_LIFT_M = 0.05
_LIFT_SHARE = 0.1  # error, as a share of a higher lift: out of the plane sets and turns in the pads are not modelled
_FREEDOM = 3.0  # of Student's t: a mistake of the observer does not decide alone
_INDEPENDENT = 5.0  # nodes err together: so many independent ones say as much
_LEAST_MOVED_M = 0.01  # an action that moved less tells of noise alone


@dataclass(frozen=True)
class Evidence:
    """What one action says of the rods of the grid."""

    log_likelihood: Float64Array  # (Y, F, S) by yield, friction and stiffness
    rmse_m: Float64Array  # (Y, F, S) [m] of what each rod predicts to what was seen


def evidence(config: ModelConfig, seen: Experience, threads: int = 0) -> Evidence | None:
    """Play an action through on every rod of the grid; None when it moved the DLO too little to tell anything."""
    if seen.moved_m.max() < _LEAST_MOVED_M:
        return None
    rods = tuple(
        QuickRod(friction_share=math.exp(a), stiffness_share=math.exp(b), yield_curvature_1_m=bend)
        for bend in YIELDS_1_M
        for a in FRICTION_LOG
        for b in STIFFNESS_LOG
    )
    patient = replace(config, rollout=replace(config.rollout, release_s=_REST_S))
    played = play(patient, seen.before_world, rods, (seen.motion(_TIMESTEP_S),), _TIMESTEP_S, threads)
    residual = np.linalg.norm((played.nodes_world[:, 0] - seen.after_world)[..., :2], axis=-1)  # (R, M)
    rmse_m = np.sqrt(np.mean(residual**2, axis=1))
    beyond_m = max(float(np.ptp(seen.tool[:, 2])) - _LOW_LIFT_M, 0.0)
    # What no rod of the grid explains is the fault of all of them: it must not choose between them.
    unexplained_m = math.hypot(_SEEN_M, _LIFT_SHARE * beyond_m, float(rmse_m.min()))
    sigma = np.hypot(unexplained_m, _MODEL_SHARE * seen.moved_m)
    square = (residual / sigma) ** 2
    # In the plane Student's t falls by (ν + 2) / 2.
    log_likelihood = -0.5 * (_FREEDOM + 2.0) * np.log1p(square / _FREEDOM).mean(axis=1) * _INDEPENDENT
    grid = (len(YIELDS_1_M), len(FRICTION_LOG), len(STIFFNESS_LOG))
    return Evidence(log_likelihood=log_likelihood.reshape(grid), rmse_m=rmse_m.reshape(grid))
