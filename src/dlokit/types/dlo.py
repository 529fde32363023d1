"""The DLO: its topology, its state, and its estimated parameters (the belief)."""

import math

from msgspec import field

from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.message import Message, Value
from dlokit.types.passing import SideWish


class Topology(Value, frozen=True, kw_only=True, eq=False):
    """Connections between nodes, as edges rather than an index order, so that branched DLOs can be described."""

    edges: Int64Array  # (E, 2) node indices
    rest_lengths_m: Float64Array  # (E,) [m]


class DloState(Message, frozen=True, kw_only=True, eq=False):
    """Estimated shape of the DLO that convergence, planning and the viewer use: the model's, after PD tracking."""

    nodes_world: Float64Array  # (M, 3) [m]
    topology: Topology
    tracking_error_m: float = 0.0
    """Root mean square distance of the visible nodes to their target points [m]."""
    visible: BoolArray | None = None  # (M,) whether the observer saw the node; None before the first observation
    observed_stamp_ns: int = 0
    """Stamp of the last cloud that corrected the state [ns]; 0 before the first."""
    health: float = 1.0
    """The observer's confidence in its targets, 0 (lost) to 1."""
    covariance: Float64Array | None = None  # (M, 3, 3) [m²] of the target points that last corrected the state
    memory: dict[str, Float64Array] = field(default_factory=dict[str, Float64Array])
    """What the observer keeps from cloud to cloud, as it was in those target points; see `TargetPoints.memory`."""


class TargetPoints(Message, frozen=True, kw_only=True, eq=False):
    """Node positions estimated by the observer, towards which PD tracking pulls the model."""

    nodes_world: Float64Array  # (M, 3) [m]
    visible: BoolArray  # (M,) False: hidden or outside the image; PD tracking must not pull this node
    covariance: Float64Array | None = None  # (M, 3, 3) [m²]
    health: float = 1.0
    """The observer's confidence, 0 (lost) to 1."""
    memory: dict[str, Float64Array] = field(default_factory=dict[str, Float64Array])
    """What the observer keeps for the next cloud, by names of its own: velocities, weights, particles. It comes back in
    the prior. Empty: it keeps nothing."""
    prior_stamp_ns: int = 0
    """Stamp of the model's state that was the prior [ns]; 0: the previous targets were, or there was none. In a live
    run only this shows which state had reached the observer."""


class GoalShape(Message, frozen=True, kw_only=True, eq=False):
    """The shape the operator wants."""

    nodes_world: Float64Array  # (M, 3) [m], in the order of the rod
    name: str = "goal"
    ends_interchangeable: bool = False
    """Whether the same shape with the order of nodes reversed is equally good."""
    beside: tuple[SideWish, ...] = ()
    """How the DLO is to pass posts, in their order along it; empty: any way."""


_CONTRADICTS_SDS = 3.0


class LogNormal(Value, frozen=True, kw_only=True, eq=False):
    """An uncertain positive parameter: its logarithm is normally distributed."""

    value: float
    """The median, which is the best estimate."""
    log_sd: float = 0.0
    """Standard deviation of the logarithm: 0.1 is about 10 %."""

    def interval(self, sds: float = 2.0) -> tuple[float, float]:
        """The interval of `sds` standard deviations of the logarithm around the median; two cover 95 %."""
        factor = math.exp(sds * self.log_sd)
        return self.value / factor, self.value * factor

    def fused_with(self, measured: "LogNormal") -> "LogNormal":
        """Fuse with a measurement, weighted by the variances; a measurement that contradicts it replaces it."""
        apart = math.log(measured.value / self.value)
        if abs(apart) > _CONTRADICTS_SDS * math.hypot(self.log_sd, measured.log_sd) or self.log_sd == 0.0:
            return measured if abs(apart) > _CONTRADICTS_SDS * measured.log_sd else self
        gain = self.log_sd**2 / (self.log_sd**2 + measured.log_sd**2)
        log_sd = self.log_sd * measured.log_sd / math.hypot(self.log_sd, measured.log_sd)
        return LogNormal(value=self.value * math.exp(gain * apart), log_sd=log_sd)


class DloBelief(Message, frozen=True, kw_only=True, eq=False):
    """Estimated parameters of the DLO: configured at first, then learned from the actions.

    The estimates of stiffness and friction are correlated: a rod on a table reveals their ratio `elastic_m3` best, so
    it is less uncertain than either.
    """

    length_m: LogNormal
    radius_m: LogNormal
    bending_stiffness_n_m2: LogNormal
    """Bending stiffness EI [N·m²]."""
    weight_n_m: LogNormal
    """Weight per length w [N/m]."""
    friction: LogNormal
    """Coefficient μ of sliding friction between DLO and table."""
    elastic_m3: LogNormal
    """EI / (μ w) [m³]; its cube root is about the radius of the tightest arc that friction holds."""
    yield_curvature_1_m: float | None = None
    """Curvature above which the DLO stays bent [1/m]; None: it always springs back."""
    takes_set: float = 1.0
    """Probability that the DLO can stay bent, 0 to 1."""
    actions: int = 0
    """Number of actions from which the estimates were learned; 0: as configured."""

    @property
    def held_radius_m(self) -> float:
        """Approximate radius of the tightest arc that friction holds, ``(EI / (μ w))^(1/3)`` [m]."""
        return self.elastic_m3.value ** (1.0 / 3.0)
