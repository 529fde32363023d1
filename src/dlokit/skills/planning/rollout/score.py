"""What remains to be done after an action, as one length, and how far actions end from what was predicted."""

import math
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description.dlo import GRAVITY_M_S2
from dlokit.description.shapes import self_clearance_m
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import RolloutResult
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.foresight import required_clearance_m
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState

_DRAPES_SHARE = 0.1  # gravity bending length (EI / w)^(1/3) over length, up to which a DLO drapes as it is laid down


def usual_error_m(kind: type[Action], model: BelievedDlo) -> float:
    """Usual prediction error (RMS) [m] of a kind of action with the DLO of the model.

    Where the DLO must drape, the error grows with the square of what it lacks to drape: a wire turns in the fingers,
    and its far end lands off the curve.
    """
    facts = kind.facts
    if not facts.drapes:
        return facts.usual_error_m
    bending_m = (model.bending_stiffness_n_m2 / (GRAVITY_M_S2 * model.mass_kg_m)) ** (1.0 / 3.0)
    return facts.usual_error_m * max(1.0, bending_m / (_DRAPES_SHARE * model.length_m)) ** 2


_MOVED_M = 0.004  # a rod that lies as before, to that RMS, was not acted on
_MOST_M = 0.05  # one failed grasp is not to bar a kind for ever


@dataclass(frozen=True)
class _Expected:
    stamp_ns: int
    kind: type[Action]
    before_world: Float64Array  # (M, 3) [m]
    after_world: Float64Array  # (M, 3) [m]


class Misses:
    """What was expected of an action, compared with the next shape: a kind that misses by much is trusted less."""

    def __init__(self, model: BelievedDlo) -> None:
        self._model = model
        self._expected: _Expected | None = None
        self._seen: dict[type[Action], list[float]] = {}

    def of(self, kind: type[Action]) -> float:
        """RMS distance of a shape to what was predicted [m]: what is usual counts as much as each action so far."""
        squares = [usual_error_m(kind, self._model) ** 2, *(miss_m**2 for miss_m in self._seen.get(kind, []))]
        return math.sqrt(float(np.mean(squares)))

    def expect(self, action: Action, shape: DloState) -> None:
        """An action is proposed for a shape; of several, the last one counts."""
        assert action.predicted_nodes_world is not None
        self._expected = _Expected(shape.stamp_ns, type(action), shape.nodes_world, action.predicted_nodes_world)

    def compare(self, shape: DloState) -> None:
        """A later shape than the one that an action was proposed for; nothing is learnt where the rod did not move."""
        expected = self._expected
        if expected is None or shape.stamp_ns == expected.stamp_ns:
            return
        self._expected = None
        if geometry.rmse_m(shape.nodes_world, expected.before_world) < _MOVED_M:
            return
        miss_m = geometry.rmse_m(shape.nodes_world, expected.after_world)
        self._seen.setdefault(expected.kind, []).append(min(miss_m, _MOST_M))


_NEXT_ACTION = 0.5  # weight of the error that one more ideal pick-and-place would leave, beside the error itself
_REACH_M = 0.08  # along the rod, over which a pick-and-place takes its neighbours with it
_CAUTION = 1.0  # standard deviations, over rods that the DLO may be, by which an action must be better
_TANGLED = 0.3  # metres of score a metre of missing clearance: a tangle is worse than any error that it saves
_TOUCHING_DIAMETERS = 1.3  # strands whose nodes came nearer than this may have gone through one another


def remaining_m(
    played: RolloutResult,
    miss_m: Float64Array,
    goal_world: Float64Array,
    radius_m: float,
    table: FeasibilityConfig,
) -> Float64Array:
    """What remains after each motion on each rod (R, C) [m], for a goal (M, 3) [m].

    `miss_m` (C,) is how far such motions usually end from what is predicted; it adds to the RMSE as what is
    independent does.

    The RMSE, and the RMSE that one more ideal action would leave: of two shapes with one error, that is better whose
    error sits in one place. Tangles and shapes off the table are dear.
    """
    nodes = played.nodes_world
    error = goal_world[:, :2] - nodes[..., :2]  # (R, C, M, 2)
    after = _after_one_more(error, goal_world, _REACH_M)
    score = np.hypot(_rms(error), miss_m) + _NEXT_ACTION * np.hypot(after, miss_m)
    required_m = required_clearance_m(goal_world)
    flat = nodes.reshape(-1, *nodes.shape[2:])
    clearance = np.array([self_clearance_m(shape) for shape in flat]).reshape(score.shape)
    clearance = np.where(played.nearest_m < _TOUCHING_DIAMETERS * 2.0 * radius_m, 0.0, clearance)
    score += _TANGLED * np.maximum(required_m - clearance, 0.0) / required_m
    return score + _off_table(nodes, table)


def least_remaining_m(miss_m: float) -> float:
    """What `remaining_m` is never below for motions that usually miss by `miss_m`, however well they are aimed [m]."""
    return (1.0 + _NEXT_ACTION) * miss_m


def cautious_m(score_m: Float64Array, caution: float = _CAUTION) -> Float64Array:
    """One score (C,) [m] from those on several rods (R, C): the mean, and `caution` standard deviations more."""
    return score_m.mean(axis=0) + caution * score_m.std(axis=0)


def _rms(error: Float64Array) -> Float64Array:
    return np.sqrt(np.mean(np.sum(error**2, axis=-1), axis=-1))


def _after_one_more(error: Float64Array, goal_world: Float64Array, reach_m: float) -> Float64Array:
    """The least RMSE (…,) [m] that moving one node to its goal leaves of errors (…, M, 2) [m].

    Its neighbours are taken to follow it by exp(-(s / reach)²) at a distance s along the rod.
    """
    s = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(goal_world, axis=0), axis=1))))
    follow = np.exp(-(((s[:, None] - s[None, :]) / reach_m) ** 2))  # (M grasped, M moved)
    # |e_i - w_ni e_n|² summed over i, without making the (M, M, 2) differences.
    square = np.sum(error**2, axis=-1)
    total = square.sum(axis=-1)[..., None] + square * np.sum(follow**2, axis=1)
    total -= 2.0 * np.einsum("...na,ni,...ia->...n", error, follow, error, optimize=True)
    return np.sqrt(np.maximum(total.min(axis=-1), 0.0) / len(goal_world))


def _off_table(nodes: Float64Array, table: FeasibilityConfig) -> Float64Array:
    """How far the farthest node lies off the usable table (R, C) [m]."""
    outside = np.zeros(nodes.shape[:-1])
    for axis, (low, high) in enumerate((table.table_x_m, table.table_y_m)):
        outside = np.maximum(outside, np.maximum(low - nodes[..., axis], nodes[..., axis] - high))
    return outside.max(axis=-1)
