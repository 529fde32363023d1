import numpy as np

from dlokit.skills.viewer.state import ErrorHistory
from dlokit.types.flow import FlowStatus


def _status(actions: int, rmse_m: float | None) -> FlowStatus:
    return FlowStatus(stamp_ns=1, flow="shape", step="compare", actions=actions, rmse_m=rmse_m)


def test_the_last_error_known_of_each_action_counts() -> None:
    history = ErrorHistory()
    for actions, rmse_m in ((0, 0.08), (1, None), (1, 0.06), (1, 0.05)):
        history.record(_status(actions, rmse_m))
    actions, rmse_m = history.arrays()
    np.testing.assert_array_equal(actions, [0, 1])
    np.testing.assert_array_equal(rmse_m, [0.08, 0.05])


def test_a_new_run_begins_a_new_plot() -> None:
    history = ErrorHistory()
    for actions, rmse_m in ((0, 0.08), (1, 0.06), (0, None), (0, 0.03)):
        history.record(_status(actions, rmse_m))
    np.testing.assert_array_equal(history.arrays()[1], [0.03])
