"""Rates of the feasibility bench, compared with manual counts."""

import pytest

from dlokit.types.feasibility import Standing
from feasibility import ALL, figures, is_right
from parts.feasibility_beliefs import Level
from parts.feasibility_cases import Judged
from parts.feasibility_releases import Happened


def judged(standing: Standing, happened: Happened, dlo: str = "rope", seconds: float = 0.1) -> Judged:
    return Judged(
        dlo=dlo,
        goal="wave-0",
        level=Level.TOLD,
        standing=standing,
        happened=happened,
        true_rmse_m=0.0,
        best_rmse_m=0.0,
        verdict_s=seconds,
    )


ROWS = (
    judged(Standing.HOLDS, Happened.STAYED),
    judged(Standing.HOLDS, Happened.STAYED, dlo="hose"),
    judged(Standing.HOLDS, Happened.REACHED),
    judged(Standing.DOUBTFUL, Happened.STAYED),
    judged(Standing.INFEASIBLE, Happened.MISSED),
    judged(Standing.INFEASIBLE, Happened.REACHED, seconds=0.9),
    judged(Standing.DOUBTFUL, Happened.MISSED),
)


def test_holds_is_correct_if_the_goal_stayed_and_infeasible_if_nothing_reached_it() -> None:
    assert [is_right(row) for row in ROWS] == [True, True, False, True, True, False, True]


def test_rates_count_verdicts_and_results() -> None:
    found = {figure.metric: figure for figure in figures(ROWS) if figure.case == ALL}
    assert (found["holds is right"].value, found["holds is right"].n) == (pytest.approx(2 / 3), 3)
    assert (found["infeasible is right"].value, found["infeasible is right"].n) == (0.5, 2)
    assert found["said doubtful"].value == pytest.approx(2 / 7)
    assert found["of goals that stay, said holds"].value == pytest.approx(2 / 3)
    assert found["of goals missed, said infeasible"].value == pytest.approx(1 / 2)
    # Clopper and Pearson, 1 of 2.
    assert (found["infeasible is right"].low, found["infeasible is right"].high) == pytest.approx(
        (0.0126, 0.9874), abs=1e-3
    )
    assert found["processor time of a verdict, largest"].value == 0.9
    assert found["processor time of a verdict, median"].value == pytest.approx(0.1)


def test_dlos_are_also_counted_separately_and_absent_verdicts_have_no_rate() -> None:
    hose = {figure.metric: figure for figure in figures(ROWS) if figure.case == "hose"}
    assert (hose["holds is right"].value, hose["holds is right"].n) == (1.0, 1)
    assert "infeasible is right" not in hose
