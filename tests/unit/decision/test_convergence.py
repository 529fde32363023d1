"""Conditions that end a shape task."""

import pytest

from dlokit.decision.config import TaskConfig
from dlokit.decision.convergence import (
    CHANGED_M,
    PROGRESS_M,
    Progress,
    SoFar,
    actions_without_progress,
    best_so_far,
    has_changed,
    progress,
    worth_it,
)

CONFIG = TaskConfig(threshold_m=0.012, max_actions=5, max_time_s=100.0, stall_actions=3)


@pytest.mark.parametrize(
    ("errors_m", "elapsed_s", "expected", "why"),
    [
        ([0.0119], 0.0, Progress.CONVERGED, None),
        ([0.012], 0.0, Progress.NOT_YET, None),
        ([0.5, 0.011], 1000.0, Progress.CONVERGED, None),
        ([0.5, 0.4, 0.3, 0.2, 0.1, 0.05], 0.0, Progress.OUT_OF_ACTIONS, "5 actions are used"),
        ([0.5, 0.4], 100.0, Progress.OUT_OF_TIME, "100 s"),
        ([0.5, 0.2, 0.3, 0.25], 0.0, Progress.NOT_YET, None),
        ([0.5, 0.2, 0.3, 0.25, 0.2], 0.0, Progress.STALLED, "after action 1"),
        ([0.5, 0.2, 0.3, 0.25, 0.19], 0.0, Progress.NOT_YET, None),
    ],
)
def test_progress_names_the_first_condition_that_holds_with_a_reason(
    errors_m: list[float], elapsed_s: float, expected: Progress, why: str | None
) -> None:
    found, said = progress(SoFar(errors_m=errors_m, elapsed_s=elapsed_s), CONFIG)
    assert found is expected
    assert said is None if why is None else said is not None and why in said


def test_one_action_is_used() -> None:
    _, said = progress(SoFar(errors_m=[0.5, 0.4]), TaskConfig(max_actions=1))
    assert said is not None
    assert said.startswith("1 action is used; ")


def test_a_wish_that_is_not_met_keeps_a_task_from_converging_and_is_in_the_reason() -> None:
    unmet = "the DLO passes A clockwise"
    assert progress(SoFar(errors_m=[0.5, 0.011], unmet=unmet), CONFIG) == (Progress.NOT_YET, unmet)
    assert progress(SoFar(errors_m=[0.5, 0.013], unmet=unmet), CONFIG) == (Progress.NOT_YET, None)
    found, said = progress(SoFar(errors_m=[0.011] * 4, unmet=unmet), CONFIG)
    assert found is Progress.STALLED
    assert said == f"no better shape in 3 actions; best RMSE 11.0 mm after action 0; {unmet}"


def test_a_doubtful_goal_is_abandoned_earlier() -> None:
    config = TaskConfig(stall_actions=3, watched_stall_actions=2)
    for doubtful, expected in ((False, Progress.NOT_YET), (True, Progress.STALLED)):
        so_far = SoFar(errors_m=[0.5, 0.2, 0.3, 0.25], doubtful=doubtful)
        assert progress(so_far, config)[0] is expected


def test_a_larger_error_is_also_a_change() -> None:
    assert has_changed(0.02, 0.03)
    assert has_changed(0.03, 0.02)
    assert not has_changed(0.03, 0.03 + 0.9 * CHANGED_M)


def test_a_new_best_within_the_noise_of_the_estimate_is_no_progress() -> None:
    assert actions_without_progress([0.02, 0.02 - 0.9 * PROGRESS_M]) == 1
    assert actions_without_progress([0.02, 0.02 - 1.1 * PROGRESS_M]) == 0


IN_VAIN = [0.05, 0.02, 0.03, 0.025, 0.021]
"""Three actions without a new best."""


@pytest.mark.parametrize(
    ("errors_m", "predicted_m", "expected"),
    [
        (IN_VAIN, 0.019, False),  # an improvement within the noise of the estimate
        (IN_VAIN, 0.018, True),
        (IN_VAIN, None, True),
        (IN_VAIN[:-1], 0.03, True),  # two are too few to stop
    ],
)
def test_after_actions_without_progress_only_a_predicted_new_best_justifies_another(
    errors_m: list[float], predicted_m: float | None, expected: bool
) -> None:
    assert worth_it(errors_m, predicted_m, CONFIG) is expected


def test_the_best_so_far_names_its_action() -> None:
    assert best_so_far([0.05, 0.02, 0.03]) == "best RMSE 20.0 mm after action 1"
