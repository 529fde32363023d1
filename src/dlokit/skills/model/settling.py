"""What becomes of a rod that is laid down and let go: friction may not hold it, and elasticity straightens it.

A rod on a level table is held where friction balances its elastic forces, which depends on one figure alone, EI / (μ w)
with w the weight per length: trials with another stiffness or friction say how sure the answer is.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.rod import RodModel, fit_length
from dlokit.types.arrays import Float64Array

_LOOK_S = 0.1  # how often it is asked whether the rod rests
_RELAX_TIMESTEP_S = 0.01  # damped as it is, the rod is stable at longer steps


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """What the rod may be instead of what the model believes."""

    stiffness_factor: float = 1.0
    """Bending stiffness over the believed one."""
    friction_factor: float = 1.0
    """Friction over the believed one."""

    def of(self, config: ModelConfig) -> ModelConfig:
        """The model as it is if the doubt is right."""
        return replace(
            config,
            bending_stiffness_n_m2=self.stiffness_factor * config.bending_stiffness_n_m2,
            friction=self.friction_factor * config.friction,
        )


def settle(config: ModelConfig, nodes_world: Float64Array) -> Float64Array:
    """Where a rod laid down as `nodes_world` (K, 3) [m] and let go comes to rest, (M, 3) [m]."""
    settle = config.settle
    rod = _laid_down(config, nodes_world, timestep_s=settle.timestep_s, damping_n_s_m=0.0)
    _until_rest(rod, settle.timestep_s, config)
    return rod.nodes_world


def relax(config: ModelConfig, nodes_world: Float64Array) -> Float64Array:
    """Where a rod (K, 3) [m] that gives way slowly comes to rest, (M, 3) [m].

    Released, a bent rod gathers speed and flies past the first shape that friction could hold. Led back slowly it
    stops there, which is nearer to where it began.
    """
    damping_n_s_m = config.settle.relax_rate_1_s * config.mass_kg_m * config.length_m / config.nodes
    rod = _laid_down(config, nodes_world, timestep_s=_RELAX_TIMESTEP_S, damping_n_s_m=damping_n_s_m)
    _until_rest(rod, _RELAX_TIMESTEP_S, config)
    return rod.nodes_world


def _laid_down(config: ModelConfig, nodes_world: Float64Array, *, timestep_s: float, damping_n_s_m: float) -> RodModel:
    rod = RodModel(config, timestep_s=timestep_s, damping_n_s_m=damping_n_s_m)
    nodes = fit_length(config, nodes_world)
    nodes[:, 2] = np.maximum(nodes[:, 2], config.radius_m)
    rod.place(nodes)
    rod.on_table(True)
    return rod


def _until_rest(rod: RodModel, timestep_s: float, config: ModelConfig) -> None:
    nodes = rod.nodes_world
    for _ in range(math.ceil(config.settle.duration_s / _LOOK_S)):
        rod.step(round(_LOOK_S / timestep_s))
        before, nodes = nodes, rod.nodes_world
        # By how far it has come rather than by its speed: a strained rod may tremble where it lies.
        if np.abs(nodes - before).max() < config.settle.rest_m_s * _LOOK_S:
            return
