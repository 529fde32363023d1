"""PD tracking: the model is dragged to the observer's target points, and its constraints reject outliers.

On each visible node acts ``F = Kp (target - x) - Kd v``, limited in size; on a held node the gripper pulls
the same way; on a hidden node acts nothing but the rod and a little friction, which keeps bends that nobody sees
from straightening. Gravity and the table's friction are off: they would hold the model off its targets, and what
they did to the real rod is in the targets already.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from dlokit.description.dlo import GRAVITY_M_S2
from dlokit.rod.believed import BelievedDlo, fit_length
from dlokit.rod.tracking_rod import RodModel
from dlokit.types.arrays import BoolArray, Float64Array

_STEP_S = 0.01  # of one physics step
_STEPS = 120  # of one update; fixed, so that runs repeat
_ROUNDS = 8  # the limit on the force is renewed this often in one update
_KP_N_M = 20.0  # proportional gain Kp of a visible node
_HELD_KP_N_M = 200.0  # the same of a node that a gripper holds
_KD_N_S_M = 0.2  # derivative gain Kd: nearly critical damping, 2 sqrt(Kp m), of a node of a rope
_FORCE_LIMIT_N = 0.25  # of one target: the rod's constraints overrule an outlier that pulls no harder
_HIDDEN_FRICTION_SHARE = 0.4  # of the table's friction, by which a hidden node stays; 0 leaves it to the rod alone
_TIGHTEST_BEND_M = 0.02  # radius of the tightest bend into which a DLO that keeps bends is followed


@dataclass(frozen=True)
class Pin:
    """A node that a gripper holds."""

    node: int
    position_world: Float64Array  # (3,) [m]


@dataclass(frozen=True)
class Tracked:
    """The model's shape after an update."""

    nodes_world: Float64Array  # (M, 3) [m]
    error_m: float
    """Root mean square distance of the visible nodes to their targets [m]; 0 when none is visible."""


class PdTracker:
    """A rod that follows target points, through posts as well: a prediction may be on the wrong side of one."""

    def __init__(self, config: BelievedDlo) -> None:
        self.config = config
        followed = replace(config, bending_stiffness_n_m2=followed_stiffness_n_m2(config))
        self._rod = RodModel(followed, timestep_s=_STEP_S, damping_n_s_m=_KD_N_S_M)

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m], none below the table."""
        nodes = self._rod.nodes_world
        nodes[:, 2] = np.maximum(nodes[:, 2], self.config.radius_m)
        return nodes

    def place(self, nodes_world: Float64Array) -> None:
        """Set the model to a curve (K, 3) [m], brought to the rod's length."""
        self._rod.place(fit_length(self.config, nodes_world))

    def track(self, targets_world: Float64Array, visible: BoolArray, pins: tuple[Pin, ...] = ()) -> Tracked:
        """Drag the model to targets (M, 3) [m]; nodes with `visible` (M,) False and no pin are left free."""
        targets = targets_world.copy()
        targets[:, 2] = np.maximum(targets[:, 2], self.config.radius_m)
        base, limit = self._gains(visible)
        for pin in pins:
            targets[pin.node], base[pin.node], limit[pin.node] = pin.position_world, _HELD_KP_N_M, np.inf
        free = ~visible & np.isfinite(limit)
        targets[free] = self._rod.nodes_world[free]
        if free.all():
            return Tracked(nodes_world=self.nodes_world, error_m=0.0)
        for round_ in range(_ROUNDS):
            pull_n = base * np.linalg.norm(targets - self._rod.nodes_world, axis=1)
            # First a target pulls no harder than the limit, so that a far shape is reached; once the shape is there,
            # what is still beyond the limit is an outlier, and the further off it is the less it pulls.
            power = np.where(visible & (round_ >= _ROUNDS // 2), 2.0, 1.0)
            gain = base * np.minimum(1.0, limit / np.maximum(pull_n, 1e-12)) ** power
            self._rod.pull(targets, np.repeat(gain[:, None], 3, axis=1))
            self._rod.step(math.ceil(_STEPS / _ROUNDS))
        return Tracked(nodes_world=self.nodes_world, error_m=_rms_m(self.nodes_world, targets_world, visible))

    def _gains(self, visible: BoolArray) -> tuple[Float64Array, Float64Array]:
        """Kp (M,) [N/m] and largest force (M,) [N] of each node's target."""
        weight_n = GRAVITY_M_S2 * self.config.mass_kg_m * self.config.length_m / self.config.nodes
        friction_n = _HIDDEN_FRICTION_SHARE * self.config.friction * weight_n
        limit = np.where(visible, _FORCE_LIMIT_N, friction_n)
        return np.full(len(visible), _KP_N_M), limit


def followed_stiffness_n_m2(config: BelievedDlo) -> float:
    """Bending stiffness with which the rod follows its targets [N·m²].

    A DLO that keeps bends resists no bend by more than its yield moment ``EI κ_y``; an elastic rod as stiff would
    straighten its kinks against the targets. At the tightest bend this one resists as much as that.
    """
    yield_1_m = config.yield_curvature_1_m or math.inf
    return config.bending_stiffness_n_m2 * min(1.0, yield_1_m * _TIGHTEST_BEND_M)


def _rms_m(nodes: Float64Array, targets: Float64Array, visible: BoolArray) -> float:
    if not visible.any():
        return 0.0
    return float(np.sqrt(np.mean(np.sum((nodes[visible] - targets[visible]) ** 2, axis=1))))
