"""How far actions end from what was predicted: by kind, as configured, and as the actions so far have shown."""

import math
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.planning.rollouts.config import ScoreConfig
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState

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

    def __init__(self, config: ScoreConfig, model: ModelConfig) -> None:
        self._config, self._model = config, model
        self._expected: _Expected | None = None
        self._seen: dict[type[Action], list[float]] = {}

    def of(self, kind: type[Action]) -> float:
        """RMS distance of a shape to what was predicted [m]: what is usual counts as much as each action so far."""
        squares = [self._config.miss_m(kind, self._model) ** 2, *(miss_m**2 for miss_m in self._seen.get(kind, []))]
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
