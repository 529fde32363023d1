"""The DLO: its topology, its state, and what is believed of it."""

import math

from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.message import Message, Value


class Topology(Value, frozen=True, kw_only=True, eq=False):
    """Which nodes are joined: edges, not an index order, so that branched DLOs fit."""

    edges: Int64Array  # (E, 2) node indices
    rest_lengths_m: Float64Array  # (E,) [m]


class DloState(Message, frozen=True, kw_only=True, eq=False):
    """The one shape that convergence, planning and the viewer use: the model's, after PD tracking."""

    nodes_world: Float64Array  # (M, 3) [m]
    topology: Topology
    tracking_error_m: float = 0.0
    """Root mean square distance of the visible nodes to their target points [m]."""
    visible: BoolArray | None = None  # (M,) whether the observer saw the node; None before the first look
    observed_stamp_ns: int = 0
    """Stamp of the cloud that the state was last corrected with [ns]; 0 before the first."""
    health: float = 1.0
    """The observer's trust in its targets, 0 (lost) to 1."""
    covariance: Float64Array | None = None  # (M, 3, 3) [m²] of the targets it was last corrected with


class TargetPoints(Message, frozen=True, kw_only=True, eq=False):
    """Where the observer believes the nodes are; the model is dragged there."""

    nodes_world: Float64Array  # (M, 3) [m]
    visible: BoolArray  # (M,) False: hidden or out of the picture; such a node must not be dragged
    covariance: Float64Array | None = None  # (M, 3, 3) [m²]
    health: float = 1.0
    """0 (lost) to 1."""


class GoalShape(Message, frozen=True, kw_only=True, eq=False):
    """The shape the operator wants."""

    nodes_world: Float64Array  # (M, 3) [m], in the order of the rod
    name: str = "goal"
    ends_interchangeable: bool = False
    """Whether a rod lying the other way round is as good."""


_CONTRADICTS_SDS = 3.0


class Figure(Value, frozen=True, kw_only=True, eq=False):
    """A number above 0 that is known to a factor: its logarithm is normally distributed."""

    value: float
    """The median; where it is not believed more or less than twice, the best guess."""
    log_sd: float = 0.0
    """Standard deviation of the logarithm: 0.1 is about 10 %."""

    def between(self, sds: float = 2.0) -> tuple[float, float]:
        """The interval of so many standard deviations to either side; of two it holds 95 %."""
        factor = math.exp(sds * self.log_sd)
        return self.value / factor, self.value * factor

    def with_measured(self, measured: "Figure") -> "Figure":
        """This figure and a measured one together, as sure as each is; one that contradicts it takes its place."""
        apart = math.log(measured.value / self.value)
        if abs(apart) > _CONTRADICTS_SDS * math.hypot(self.log_sd, measured.log_sd) or self.log_sd == 0.0:
            return measured if abs(apart) > _CONTRADICTS_SDS * measured.log_sd else self
        share = self.log_sd**2 / (self.log_sd**2 + measured.log_sd**2)
        log_sd = self.log_sd * measured.log_sd / math.hypot(self.log_sd, measured.log_sd)
        return Figure(value=self.value * math.exp(share * apart), log_sd=log_sd)


class DloBelief(Message, frozen=True, kw_only=True, eq=False):
    """The DLO as the system believes it to be, as configured at first and as learnt from then on.

    Stiffness and friction are not independent of one another: what a rod on a table shows best is the ratio of both,
    `elastic_m3`, which is surer than either.
    """

    length_m: Figure
    radius_m: Figure
    bending_stiffness_n_m2: Figure
    """Bending stiffness EI [N·m²]."""
    weight_n_m: Figure
    """Weight per length w [N/m]."""
    friction: Figure
    """Coefficient μ of sliding friction on the table."""
    elastic_m3: Figure
    """EI / (μ w) [m³] of these figures; its cube root is about the radius of the tightest arc that friction holds."""
    yield_curvature_1_m: float | None = None
    """Curvature beyond which the DLO keeps a bend [1/m]; None: it is taken to spring back always."""
    takes_set: float = 1.0
    """How probable it is that the DLO keeps bends at all, 0 to 1."""
    actions: int = 0
    """Actions that it was learnt from; 0: it is what was configured."""

    @property
    def held_radius_m(self) -> float:
        """About the radius of the tightest arc that friction holds, ``(EI / (μ w))^(1/3)`` [m]."""
        return self.elastic_m3.value ** (1.0 / 3.0)
