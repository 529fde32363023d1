"""The true error in `info`: of both orders of nodes where the goal's ends are interchangeable, as the evaluator's."""

import numpy as np
import pytest

from dlokit.description.shapes import builtin_shape
from dlokit.extras.gym.observations import TrueNodes
from dlokit.types.dlo import GoalShape

U_SHAPE = builtin_shape("U", 0.5, 31)


@pytest.mark.parametrize("system", [U_SHAPE, U_SHAPE[::-1]])
def test_interchangeable_ends_are_interchangeable_in_the_true_error_too(system: np.ndarray) -> None:
    away = np.array([0.02, 0.0, 0.0])
    truth = TrueNodes(lambda: U_SHAPE + away, first_world=system)
    for goal_world in (system, system[::-1]):
        either = GoalShape(stamp_ns=0, nodes_world=goal_world, ends_interchangeable=True)
        assert truth.rmse_m(either) == pytest.approx(0.02, abs=1e-4)
    assert truth.rmse_m(GoalShape(stamp_ns=0, nodes_world=system)) == pytest.approx(0.02, abs=1e-4)
    assert truth.rmse_m(GoalShape(stamp_ns=0, nodes_world=system[::-1])) > 0.1, "the wrong way round"
