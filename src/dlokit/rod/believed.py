"""The DLO as the system assumes it: its physical parameters and their uncertainty.

They deliberately differ from the simulated cell's parameters: in a lab the exact parameters are unknown, too.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from msgspec import Meta

from dlokit import geometry
from dlokit.description.dlo import GRAVITY_M_S2
from dlokit.ranges import Fraction, NotNegative, Positive, check_ranges
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, LogNormal, Topology

POISSON = 0.3
"""Poisson's ratio assumed for every DLO: it sets the torsional stiffness, which no picture shows."""
DAMPING_S = 0.05
"""Damping assumed for every DLO: ratio of viscous to elastic bending moment [s]; a resting DLO does not show it."""


@dataclass(frozen=True, kw_only=True)
class BeliefConfig:
    """Uncertainty of the model's parameters: standard deviations of their logarithms, 0.1 is about 10 %."""

    length_log_sd: NotNegative = 0.01
    """Uncertainty of the length. Larger: less certain."""
    radius_log_sd: NotNegative = 0.05
    """Uncertainty of the radius. Larger: less certain."""
    stiffness_log_sd: NotNegative = 0.35
    """Uncertainty of the bending stiffness. Larger: goals and finalists are tested with softer and stiffer DLOs."""
    weight_log_sd: NotNegative = 0.15
    """Uncertainty of the mass per length. Larger: more goals are judged doubtful."""
    friction_log_sd: NotNegative = 0.25
    """Uncertainty of the friction. Larger: goals and finalists are tested with smoother and rougher tables."""
    takes_set: Fraction = 0.2
    """Probability, 0 to 1, that the DLO is plastic when no yield curvature is configured. Above 0.05 no goal is
    called infeasible for springing back; set 0 for a DLO that is known to be elastic."""

    def __post_init__(self) -> None:
        check_ranges(self, "model.belief")


@dataclass(frozen=True, kw_only=True)
class BelievedDlo:
    """The DLO as the system assumes it: the one description that all components use."""

    nodes: Annotated[int, Meta(ge=3)] = 31
    """Number of nodes M; the paper divides its DLO into 30 segments. Larger: finer shapes, more computation."""
    length_m: Positive = 0.5
    """Length of the DLO [m]."""
    radius_m: Positive = 0.004
    """Radius of the DLO [m]."""
    bending_stiffness_n_m2: Positive = 1.3e-5
    """Bending stiffness EI [N·m²]. Larger: it springs back more when released."""
    mass_kg_m: Positive = 0.035
    """Mass per length [kg/m]. Larger: friction holds it more firmly."""
    friction: Positive = 0.6
    """Sliding friction coefficient between the DLO and the table. Larger: tighter bends hold."""
    yield_curvature_1_m: Positive | None = None
    """Curvature beyond which the DLO keeps a bend [1/m], 1 for a copper wire; without it the DLO is assumed to spring
    back always, except with the probability in `--model.belief.takes-set`."""
    belief: BeliefConfig = field(default_factory=BeliefConfig)
    """Uncertainty of these parameters."""

    def __post_init__(self) -> None:
        check_ranges(self, "model")


def as_configured(config: BelievedDlo, stamp_ns: int) -> DloBelief:
    """The belief before the first action: the configured parameters."""
    sure = config.belief
    weight_n_m = GRAVITY_M_S2 * config.mass_kg_m
    return DloBelief(
        stamp_ns=stamp_ns,
        length_m=LogNormal(value=config.length_m, log_sd=sure.length_log_sd),
        radius_m=LogNormal(value=config.radius_m, log_sd=sure.radius_log_sd),
        bending_stiffness_n_m2=LogNormal(value=config.bending_stiffness_n_m2, log_sd=sure.stiffness_log_sd),
        weight_n_m=LogNormal(value=weight_n_m, log_sd=sure.weight_log_sd),
        friction=LogNormal(value=config.friction, log_sd=sure.friction_log_sd),
        elastic_m3=LogNormal(
            value=config.bending_stiffness_n_m2 / (config.friction * weight_n_m),
            log_sd=math.hypot(sure.stiffness_log_sd, sure.weight_log_sd, sure.friction_log_sd),
        ),
        yield_curvature_1_m=config.yield_curvature_1_m,
        takes_set=sure.takes_set if config.yield_curvature_1_m is None else 1.0,
    )


def with_belief(config: BelievedDlo, belief: DloBelief) -> BelievedDlo:
    """The model with the parameters and the uncertainty of a belief."""
    return replace(
        config,
        length_m=belief.length_m.value,
        radius_m=belief.radius_m.value,
        bending_stiffness_n_m2=belief.bending_stiffness_n_m2.value,
        mass_kg_m=belief.weight_n_m.value / GRAVITY_M_S2,
        friction=belief.friction.value,
        yield_curvature_1_m=belief.yield_curvature_1_m,
        belief=BeliefConfig(
            length_log_sd=belief.length_m.log_sd,
            radius_log_sd=belief.radius_m.log_sd,
            stiffness_log_sd=belief.bending_stiffness_n_m2.log_sd,
            weight_log_sd=belief.weight_n_m.log_sd,
            friction_log_sd=belief.friction.log_sd,
            takes_set=belief.takes_set,
        ),
    )


def topology(config: BelievedDlo) -> Topology:
    """The rod's edges: a single line of equal segments."""
    return in_a_row(np.full(config.nodes - 1, config.length_m / (config.nodes - 1)))


def in_a_row(rest_lengths_m: Float64Array) -> Topology:
    """The edges of a rod whose nodes are joined one to the next, with these lengths (E,) [m] at rest."""
    first = np.arange(len(rest_lengths_m), dtype=np.int64)
    return Topology(edges=np.column_stack((first, first + 1)), rest_lengths_m=rest_lengths_m)


def fit_length(config: BelievedDlo, nodes_world: Float64Array) -> Float64Array:
    """A curve (K, 3) [m] as the rod's nodes (M, 3): its ends cut or prolonged equally to the rod's length."""
    s = geometry.arc_lengths(nodes_world)
    if len(nodes_world) == config.nodes and abs(s[-1] - config.length_m) < 0.005 * config.length_m:
        # Already a rod of this length. Resampling would cut its corners a little each time.
        return nodes_world.copy()
    excess = (s[-1] - config.length_m) / 2.0
    wanted = np.linspace(excess, s[-1] - excess, config.nodes)
    inside = np.clip(wanted, 0.0, s[-1])
    nodes = np.column_stack([np.interp(inside, s, nodes_world[:, axis]) for axis in range(3)])
    start, end = geometry.tangents(nodes_world)[[0, -1]]
    return nodes + np.outer(np.minimum(wanted, 0.0), start) + np.outer(np.maximum(wanted - s[-1], 0.0), end)
