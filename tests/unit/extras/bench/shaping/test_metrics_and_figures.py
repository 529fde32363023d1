from pathlib import Path

import msgspec
import numpy as np
import pytest
from made_fixtures import FURNISHED
from matplotlib.image import imread
from shaping_results import BENT, FARTHEST, ROLLOUT, STRAIGHT, done, run

from dlokit.description.scene import Fixture
from dlokit.extras.bench.report import BenchFigure
from dlokit.extras.bench.shaping import metrics, pictures
from dlokit.extras.bench.shaping.cases import ShapingCase, judged_by_truth
from dlokit.extras.bench.shaping.figures import COLUMNS as HEADINGS
from dlokit.extras.bench.shaping.figures import experiment_rows, figures, group_rows, outcomes, overview, verdict_lines
from dlokit.types.feasibility import Standing
from dlokit.types.flow import RunOutcome

GOOD = run([0.05, 0.02, 0.010])
FALSE = run([0.05, 0.010], true_m=0.0141)
STALLED = run([0.05, 0.03, 0.03, 0.03, 0.03], outcome=RunOutcome.STALLED, said=Standing.DOUBTFUL)


def _find(rows: list[BenchFigure], case: str, method: str, metric: str) -> BenchFigure:
    (row,) = [row for row in rows if (row.case, row.method, row.metric) == (case, method, metric)]
    return row


def test_a_convergence_is_false_if_the_true_error_is_two_millimetres_above_the_threshold() -> None:
    assert metrics.falsely_converged(FALSE)
    assert not metrics.falsely_converged(run([0.05, 0.010], true_m=0.0139))
    assert not metrics.falsely_converged(STALLED)


def test_a_goal_that_was_replaced_is_not_reached() -> None:
    assert metrics.converged(GOOD)
    assert not metrics.converged(run([0.05, 0.010], said=Standing.INFEASIBLE, projected=True))


def test_actions_without_progress_count_from_the_last_new_best() -> None:
    assert metrics.idle_actions(STALLED) == 3
    assert metrics.idle_actions(GOOD) == 0
    # An improvement below the threshold of a change.
    assert metrics.idle_actions(run([0.05, 0.03, 0.0299, 0.0298], outcome=RunOutcome.STALLED)) == 2
    # A run that ended before it saw the DLO has no errors.
    assert metrics.idle_actions(msgspec.structs.replace(GOOD, start_rmse_m=None, history=())) == 0


def test_each_statistic_is_per_experiment_per_group_and_over_all() -> None:
    rows = figures([done(GOOD), done(STALLED, seed=1), done(GOOD, STRAIGHT), done(GOOD, method=ROLLOUT)])

    assert _find(rows, "I to S", FARTHEST.name, "converged").value == 0.5
    assert _find(rows, "bent", FARTHEST.name, "converged").n == 2
    assert _find(rows, "all", FARTHEST.name, "converged").value == pytest.approx(2 / 3)
    assert _find(rows, "all", ROLLOUT.name, "converged").value == 1.0
    assert _find(rows, "verdict doubtful", FARTHEST.name, "converged").value == 0.0
    assert _find(rows, "all", FARTHEST.name, "median actions").value == 2.0
    assert _find(rows, "all", FARTHEST.name, "max actions").value == 4.0
    assert _find(rows, "all", FARTHEST.name, "median robot_time_s").value == 20.0
    assert _find(rows, "all", FARTHEST.name, "median path_length_m").value == 2.0
    assert _find(rows, "all", FARTHEST.name, "median true_largest_m").value == pytest.approx(0.02)
    assert _find(rows, "all", FARTHEST.name, "mean actions, drag").value == pytest.approx(8 / 3)
    assert _find(rows, "all", FARTHEST.name, "max planning_time_s an action").value == 4.0
    assert _find(rows, "all", FARTHEST.name, "outcome stalled").value == pytest.approx(1 / 3)
    assert _find(rows, "all", FARTHEST.name, "runs without expected progress stopped in time").n == 1


def test_a_rate_has_the_exact_interval_and_its_number_of_runs() -> None:
    row = _find(figures([done(GOOD, seed=seed) for seed in range(20)]), "all", FARTHEST.name, "converged")

    assert (row.value, row.high, row.n) == (1.0, 1.0, 20)
    assert row.low == pytest.approx(0.8316, abs=1e-4)  # Clopper-Pearson: 0.025^(1/20)


def test_an_infeasible_goal_is_refuted_by_whichever_planner_reaches_it_in_the_same_cell() -> None:
    said = run([0.05, 0.04], outcome=RunOutcome.STALLED, said=Standing.INFEASIBLE)
    proof = run([0.05, 0.01], said=Standing.INFEASIBLE)

    rows = figures([done(said), done(proof, method=ROLLOUT), done(said, seed=1), done(GOOD, STRAIGHT)])

    refuted = _find(rows, "verdicts", "any", "infeasible goals that a run reached")
    assert (refuted.value, refuted.n) == (0.5, 2)
    assert _find(rows, "verdicts", "any", "goals said infeasible").value == 0.5
    assert _find(rows, "verdicts", FARTHEST.name, "reached, said holds").value == 1.0


def test_a_false_convergence_refutes_no_verdict() -> None:
    rows = figures([done(run([0.05, 0.010], true_m=0.02, said=Standing.INFEASIBLE))])

    assert _find(rows, "verdicts", "any", "infeasible goals that a run reached").value == 0.0


def test_the_table_has_a_cell_for_every_heading() -> None:
    results = [done(GOOD), done(FALSE, seed=1), done(STALLED, drawn=False, seed=2)]

    rows = [*overview(experiment_rows(results), truth=True), *overview(group_rows(results), truth=True)]

    assert all(len(row) == len(HEADINGS) for row in rows)
    assert rows[0][2] == "2/3"
    assert rows[0][HEADINGS.index("by kind")] == "drag 7"
    assert rows[0][HEADINGS.index("false")] == "1"
    assert list(outcomes(results)) == [
        "farthest, map: 2 converged, 1 stalled; 1 without expected progress, 0 of them over 3 actions"
    ]
    assert list(verdict_lines(results)) == ["farthest, map: holds: 1 of 2 reached, doubtful: 0 of 1 reached"]


def test_without_a_truth_nothing_is_called_reached_or_false_and_no_true_error_is_made_up() -> None:
    good = msgspec.structs.replace(GOOD, true_rmse_m=None, true_largest_m=None)
    results = [done(good), done(good, seed=1)]

    rows = figures(results)
    table = next(overview(experiment_rows(results), truth=judged_by_truth(results)))

    said = {row.metric for row in rows}
    assert {"median rmse_m", "converged", "converged, said holds"} <= said
    assert not any("true" in metric or "false" in metric or "reached" in metric for metric in said)
    assert [table[HEADINGS.index(name)] for name in ("true mm", "farthest mm", "false")] == ["-", "-", "-"]
    assert list(verdict_lines(results)) == ["farthest, map: holds: 2 of 2 converged"]


def test_runs_of_a_cell_that_all_failed_are_still_judged_by_its_truth() -> None:
    assert judged_by_truth([done(GOOD), done(msgspec.structs.replace(GOOD, true_rmse_m=None))])
    assert judged_by_truth([done(msgspec.structs.replace(GOOD, rmse_m=None, true_rmse_m=None), drawn=False)])


def test_every_case_that_did_not_crash_has_a_panel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "ROWS", 1)
    cases = [done(GOOD, seed=seed) for seed in range(pictures.COLUMNS + 1)]

    paths = pictures.draw([*cases, done(STALLED, method=ROLLOUT, drawn=False)], tmp_path)

    assert [path.name for path in paths] == ["cases-farthest-map-1.png", "cases-farthest-map-2.png"]
    assert all(path.stat().st_size > 0 for path in paths)
    assert BENT.name == cases[0].case.experiment.name


def test_a_panel_shows_the_fixtures_of_its_case(tmp_path: Path) -> None:
    def drawn(case: ShapingCase) -> tuple[Fixture, ...]:
        return FURNISHED.fixtures if case.seed else ()

    cases = [done(GOOD, seed=seed) for seed in (0, 1)]
    for name, fixtures_of in (("bare", lambda case: ()), ("furnished", drawn)):
        (tmp_path / name).mkdir()
        pictures.draw(cases, tmp_path / name, fixtures_of)
    bare, furnished = (imread(tmp_path / name / "cases-farthest-map-1.png") for name in ("bare", "furnished"))
    columns = np.nonzero(np.abs(bare - furnished).max(axis=(0, 2)) > 0.1)[0]
    panel_px = bare.shape[1] / pictures.COLUMNS
    assert len(columns)
    assert panel_px < columns.min() <= columns.max() < 2 * panel_px
