"""What the model believes of the DLO: as configured at first."""

import math

from dlokit.skills.model.config import ModelConfig
from dlokit.types.dlo_belief import DloBelief, Figure

GRAVITY_M_S2 = 9.81


def as_configured(config: ModelConfig, stamp_ns: int) -> DloBelief:
    """The belief before anything was learnt."""
    sure = config.belief
    weight_n_m = GRAVITY_M_S2 * config.mass_kg_m
    return DloBelief(
        stamp_ns=stamp_ns,
        length_m=Figure(value=config.length_m, log_sd=sure.length_log_sd),
        radius_m=Figure(value=config.radius_m, log_sd=sure.radius_log_sd),
        bending_stiffness_n_m2=Figure(value=config.bending_stiffness_n_m2, log_sd=sure.stiffness_log_sd),
        weight_n_m=Figure(value=weight_n_m, log_sd=sure.weight_log_sd),
        friction=Figure(value=config.friction, log_sd=sure.friction_log_sd),
        elastic_m3=Figure(
            value=config.bending_stiffness_n_m2 / (config.friction * weight_n_m),
            log_sd=math.hypot(sure.stiffness_log_sd, sure.weight_log_sd, sure.friction_log_sd),
        ),
        yield_curvature_1_m=config.yield_curvature_1_m,
        takes_set=sure.takes_set if config.yield_curvature_1_m is None else 1.0,
    )
