"""From what actions said to a belief: Bayes' rule on a grid of friction, stiffness and yield.

The prior is what was configured, or, with some chance, quite another DLO: a model may have been set up for a rope when
a wire lies on the table.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from scipy.interpolate import RectBivariateSpline

from dlokit.skills.model.belief import as_configured
from dlokit.skills.model.config import BeliefConfig, ModelConfig
from dlokit.skills.model.identification.evidence import FRICTION_LOG, STIFFNESS_LOG, YIELDS_1_M, Evidence
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo_belief import DloBelief, Figure

_ANOTHER = 0.2  # chance of a DLO that is not what was configured
_ANOTHER_STIFFNESS_LOG_SD = 2.5
_ANOTHER_FRICTION_LOG_SD = 0.4
_OTHER_YIELD = 0.2  # chance that a DLO that is told to take a set does so at another curvature, or never
_NO_CHANCE = 1e-12  # of what is told to be impossible
_MODEL_LOG_SD = 0.1  # the rod of planning is not the DLO, however often it was seen
_SET_MODEL_LOG_SD = 0.3  # less so where it takes a set: how much is strained before an action nobody sees
_FINER = 8  # points of the fine grid in one cell of the coarse one


@dataclass(frozen=True)
class Posterior:
    """How probable each rod is: yields Y, frictions F and stiffnesses S on a fine grid."""

    probability: Float64Array  # (Y, F, S), its sum is 1
    friction_log: Float64Array  # (F,) over the model's
    stiffness_log: Float64Array  # (S,) over the model's

    @property
    def best_yield(self) -> int:
        """Index of the most probable yield."""
        return int(self.probability.sum(axis=(1, 2)).argmax())

    @property
    def takes_set(self) -> float:
        """How probable it is that the DLO keeps bends at all."""
        finite = np.isfinite(np.array(YIELDS_1_M))
        return min(1.0, float(self.probability[finite].sum()))


def posterior(config: ModelConfig, heard: Sequence[Evidence]) -> Posterior:
    """Bayes' rule over everything that was heard."""
    fine_friction, fine_stiffness = _fine(FRICTION_LOG), _fine(STIFFNESS_LOG)
    total = np.zeros((len(YIELDS_1_M), len(FRICTION_LOG), len(STIFFNESS_LOG)))
    for one in heard:
        total += one.log_likelihood
    fine = np.stack(
        [RectBivariateSpline(FRICTION_LOG, STIFFNESS_LOG, layer, kx=2, ky=2)(fine_friction, fine_stiffness)
         for layer in total]
    )  # fmt: skip
    weight = fine + _log_prior(config, fine_friction, fine_stiffness)
    probability = np.exp(weight - weight.max())
    return Posterior(
        probability=probability / probability.sum(), friction_log=fine_friction, stiffness_log=fine_stiffness
    )


def believed(config: ModelConfig, of: Posterior, actions: int, stamp_ns: int) -> DloBelief:
    """The belief that a posterior stands for: the most probable yield, and mean and spread of the rest under it."""
    layer = of.probability[of.best_yield]
    layer = layer / layer.sum()
    friction, stiffness = _moments(layer, of.friction_log[:, None]), _moments(layer, of.stiffness_log[None, :])
    ratio = _moments(layer, of.stiffness_log[None, :] - of.friction_log[:, None])
    before = as_configured(config, stamp_ns)
    bend = YIELDS_1_M[of.best_yield]
    floor = _MODEL_LOG_SD if math.isinf(bend) else _SET_MODEL_LOG_SD
    return msgspec.structs.replace(
        before,
        # All that a rod on a table shows is EI / w and μ: the doubt of the weight stays in EI alone.
        bending_stiffness_n_m2=_scaled(
            before.bending_stiffness_n_m2, stiffness, math.hypot(floor, config.belief.weight_log_sd)
        ),
        friction=_scaled(before.friction, friction, floor),
        elastic_m3=_scaled(before.elastic_m3, ratio, floor),
        yield_curvature_1_m=None if math.isinf(bend) else bend,
        takes_set=of.takes_set,
        actions=actions,
    )


def as_believed(config: ModelConfig, belief: DloBelief) -> ModelConfig:
    """The model with the figures of a belief."""
    return replace(
        config,
        bending_stiffness_n_m2=belief.bending_stiffness_n_m2.value,
        friction=belief.friction.value,
        yield_curvature_1_m=belief.yield_curvature_1_m,
        belief=replace(
            config.belief,
            stiffness_log_sd=belief.bending_stiffness_n_m2.log_sd,
            friction_log_sd=belief.friction.log_sd,
            takes_set=belief.takes_set,
        ),
    )


def _fine(coarse: Float64Array) -> Float64Array:
    return np.linspace(coarse[0], coarse[-1], _FINER * (len(coarse) - 1) + 1)


def _log_prior(config: ModelConfig, friction_log: Float64Array, stiffness_log: Float64Array) -> Float64Array:
    """Of every rod (Y, F, S), up to a constant."""
    sure: BeliefConfig = config.belief
    a, b = friction_log[:, None], stiffness_log[None, :]
    same = (1.0 - _ANOTHER) * _normal(a, sure.friction_log_sd) * _normal(b, sure.stiffness_log_sd)
    other = _ANOTHER * _normal(a, _ANOTHER_FRICTION_LOG_SD) * _normal(b, _ANOTHER_STIFFNESS_LOG_SD)
    plane = np.log(same + other)
    told = config.yield_curvature_1_m
    other_yield = sure.takes_set if told is None else _OTHER_YIELD
    shares = [max(other_yield, _NO_CHANCE) / (len(YIELDS_1_M) - 1)] * len(YIELDS_1_M)
    nearest = 0 if told is None else int(np.argmin([abs(math.log(bend / told)) for bend in YIELDS_1_M]))
    shares[nearest] = max(1.0 - other_yield, _NO_CHANCE)
    return np.log(np.array(shares))[:, None, None] + plane


def _normal(log: Float64Array, sd: float) -> Float64Array:
    sd = max(sd, 1e-3)
    return np.exp(-0.5 * (log / sd) ** 2) / sd


def _moments(probability: Float64Array, log: Float64Array) -> tuple[float, float]:
    mean = float((probability * log).sum())
    return mean, math.sqrt(float((probability * (log - mean) ** 2).sum()))


def _scaled(before: Figure, log: tuple[float, float], doubt_log_sd: float) -> Figure:
    log_sd = math.hypot(log[1], doubt_log_sd)
    return Figure(value=before.value * math.exp(log[0]), log_sd=log_sd)
