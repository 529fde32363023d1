"""The bench of verdicts, on a case whose answer is known."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.app.bench_feasibility import FeasibilityArgs, run_feasibility
from dlokit.bench.feasibility import Happened, judge_all
from dlokit.description.dlo import STIFF_WIRE
from dlokit.errors import InputError
from dlokit.functional.cell.config import CellConfig
from dlokit.skills.planning.config import PlanningConfig
from dlokit.types.feasibility import Standing

GOALS = Path(__file__).parents[4] / "shared" / "data" / "goals" / "planar_goals.npy"


def test_a_stiff_wire_stays_straight_and_springs_back_from_the_s_as_the_verdicts_say() -> None:
    judged = {row.goal: row for row in judge_all({}, CellConfig(dlo=STIFF_WIRE), PlanningConfig(), 0.012)}
    assert (judged["I"].standing, judged["I"].happened) == (Standing.HOLDS, Happened.STAYED)
    assert (judged["S"].standing, judged["S"].happened) == (Standing.INFEASIBLE, Happened.SPRANG_BACK)


def test_published_goals_that_are_said_to_hold_do() -> None:
    if not GOALS.exists():
        pytest.skip("the published planar goals are not on this machine")
    curves = {str(index): curve.astype(np.float64) for index, curve in enumerate(np.load(GOALS)[::20])}
    for row in judge_all(curves, CellConfig(), PlanningConfig(), 0.012):
        assert row.standing is not Standing.HOLDS or row.happened is Happened.STAYED, row


def test_a_file_that_holds_no_goals_is_named(tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.zeros((4, 2)))
    with pytest.raises(InputError, match=r"flat\.npy are"):
        run_feasibility(FeasibilityArgs(goals=tmp_path / "flat.npy", dlos=("soft_rope",)))
