"""The score of an action: the error that remains after it, as one length; and the prediction errors of each kind."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description.dlo import GRAVITY_M_S2
from dlokit.description.passing import wrong_sides
from dlokit.description.scene import Fixture
from dlokit.description.shapes import self_clearance_m
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import RolloutResult
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.foresight import required_clearance_m
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.passing import SideWish

_DRAPES_FRACTION = 0.1  # gravity bending length (EI / w)^(1/3) over length, up to which a DLO drapes as it is laid down


def usual_error_m(kind: type[Action], model: BelievedDlo) -> float:
    """Usual prediction error (RMS) [m] of a kind of action with the DLO of the model.

    Where the DLO must drape, the error grows with the square of what it lacks to drape: a wire turns in the fingers,
    and its far end lands off the curve.
    """
    facts = kind.facts
    if not facts.drapes:
        return facts.usual_error_m
    bending_m = (model.bending_stiffness_n_m2 / (GRAVITY_M_S2 * model.mass_kg_m)) ** (1.0 / 3.0)
    return facts.usual_error_m * max(1.0, bending_m / (_DRAPES_FRACTION * model.length_m)) ** 2


_MOVED_M = 0.004  # RMS displacement below which the action did not move the rod
_MOST_M = 0.05  # largest error that counts, so that one failed grasp does not exclude a kind for the rest of the task


@dataclass(frozen=True)
class _Expected:
    stamp_ns: int
    kind: type[Action]
    before_world: Float64Array  # (M, 3) [m]
    after_world: Float64Array  # (M, 3) [m]


class PredictionErrors:
    """Prediction errors of the executed actions of each kind: the score of a kind with large errors is worse."""

    def __init__(self, model: BelievedDlo) -> None:
        self._model = model
        self._expected: _Expected | None = None
        self._seen: dict[type[Action], list[float]] = {}

    def of(self, kind: type[Action]) -> float:
        """RMS prediction error of a kind [m]; the usual error has the weight of one executed action."""
        squares = [usual_error_m(kind, self._model) ** 2, *(error_m**2 for error_m in self._seen.get(kind, []))]
        return math.sqrt(float(np.mean(squares)))

    def expect(self, action: Action, shape: DloState) -> None:
        """Note an action that is proposed for a shape; it replaces an earlier one."""
        assert action.predicted_nodes_world is not None
        self._expected = _Expected(shape.stamp_ns, type(action), shape.nodes_world, action.predicted_nodes_world)

    def compare(self, shape: DloState) -> None:
        """Compare the shape after an action with its prediction; a rod that did not move is ignored."""
        expected = self._expected
        if expected is None or shape.stamp_ns == expected.stamp_ns:
            return
        self._expected = None
        if geometry.rmse_m(shape.nodes_world, expected.before_world) < _MOVED_M:
            return
        error_m = geometry.rmse_m(shape.nodes_world, expected.after_world)
        self._seen.setdefault(expected.kind, []).append(min(error_m, _MOST_M))


_NEXT_ACTION = 0.5  # weight of the error that one more ideal pick-and-place would leave, beside the error itself
_REACH_M = 0.08  # along the rod, over which a pick-and-place takes its neighbours with it
_CAUTION = 1.0  # standard deviations over the plausible rods that are added to the mean score
_TANGLED = 0.3  # metres of score a metre of missing clearance: a tangle is worse than any error that it saves
_WRONG_SIDE_M = 0.02  # score of a post on the wrong side: it takes one more action
_TOUCHING_DIAMETERS = 1.3  # strands whose nodes came nearer than this may have passed through each other


def remaining_m(
    simulated: RolloutResult,
    error_m: Float64Array,
    goal_world: Float64Array,
    radius_m: float,
    table: FeasibilityConfig,
) -> Float64Array:
    """The remaining error after each motion on each rod (R, C) [m], for a goal (M, 3) [m].

    It is the sum of the RMSE and the RMSE that one more ideal action would leave: of two shapes with the same RMSE,
    the one whose error is concentrated in one place is better. `error_m` (C,) is the usual prediction error of each
    motion; it adds to both as an independent error. Tangles and shapes off the table are costly.
    """
    nodes = simulated.nodes_world
    error = goal_world[:, :2] - nodes[..., :2]  # (R, C, M, 2)
    after = _after_one_more(error, goal_world, _REACH_M)
    score = np.hypot(_rms(error), error_m) + _NEXT_ACTION * np.hypot(after, error_m)
    required_m = required_clearance_m(goal_world)
    flat = nodes.reshape(-1, *nodes.shape[2:])
    clearance = np.array([self_clearance_m(shape) for shape in flat]).reshape(score.shape)
    clearance = np.where(simulated.nearest_m < _TOUCHING_DIAMETERS * 2.0 * radius_m, 0.0, clearance)
    score += _TANGLED * np.maximum(required_m - clearance, 0.0) / required_m
    return score + _off_table(nodes, table)


def by_sides_m(
    nodes_world: Float64Array,
    wish: Sequence[SideWish],
    fixtures: Sequence[Fixture],
    *,
    ends_interchangeable: bool = False,
) -> Float64Array:
    """What posts that are passed on the wrong side add to the score (…) [m] of shapes (…, M, 3) [m].

    A shape near the goal with a post on the wrong side is farther from it than its RMSE says: the DLO must be lifted
    over the post.
    """
    flat = nodes_world.reshape(-1, *nodes_world.shape[-2:])
    wrong = wrong_sides(flat, fixtures, wish, ends_interchangeable=ends_interchangeable)
    return np.asarray(_WRONG_SIDE_M * wrong, dtype=np.float64).reshape(nodes_world.shape[:-2])


def least_remaining_m(error_m: float) -> float:
    """Lower bound of `remaining_m` [m] for motions with the usual prediction error `error_m`."""
    return (1.0 + _NEXT_ACTION) * error_m


def cautious_m(score_m: Float64Array, caution: float = _CAUTION) -> Float64Array:
    """One score (C,) [m] from the scores on several rods (R, C): the mean plus `caution` standard deviations."""
    return score_m.mean(axis=0) + caution * score_m.std(axis=0)


def _rms(error: Float64Array) -> Float64Array:
    return np.sqrt(np.mean(np.sum(error**2, axis=-1), axis=-1))


def _after_one_more(error: Float64Array, goal_world: Float64Array, reach_m: float) -> Float64Array:
    """The smallest RMSE (…,) [m] that remains of errors (…, M, 2) [m] when one node is moved to its goal.

    Its neighbours are assumed to follow it by exp(-(s / reach)²) at a distance s along the rod.
    """
    s = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(goal_world, axis=0), axis=1))))
    follow = np.exp(-(((s[:, None] - s[None, :]) / reach_m) ** 2))  # (M grasped, M moved)
    # |e_i - w_ni e_n|² summed over i, without making the (M, M, 2) differences.
    square = np.sum(error**2, axis=-1)
    total = square.sum(axis=-1)[..., None] + square * np.sum(follow**2, axis=1)
    total -= 2.0 * np.einsum("...na,ni,...ia->...n", error, follow, error, optimize=True)
    return np.sqrt(np.maximum(total.min(axis=-1), 0.0) / len(goal_world))


def _off_table(nodes: Float64Array, table: FeasibilityConfig) -> Float64Array:
    """Distance of the farthest node from the usable table (R, C) [m]; 0 on it."""
    outside = np.zeros(nodes.shape[:-1])
    for axis, (low, high) in enumerate((table.table_x_m, table.table_y_m)):
        outside = np.maximum(outside, np.maximum(low - nodes[..., axis], nodes[..., axis] - high))
    return outside.max(axis=-1)
