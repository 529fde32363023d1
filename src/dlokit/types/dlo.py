"""The DLO: its topology and its state."""

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
