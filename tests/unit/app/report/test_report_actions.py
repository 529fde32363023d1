"""Sections of a report on predictions of actions, and on control."""

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from made_fixtures import FURNISHED
from made_results import made_action, made_record, made_run

from dlokit.app.report import figures
from dlokit.app.report.drawing import draw_fixtures, new_figure
from dlokit.app.report.page import report_html
from dlokit.decision.records import CorrectionRecord
from dlokit.description import shapes
from dlokit.description.scene import outline_xy
from dlokit.system.results.run_result import RunRecord
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import RunOutcome

GOAL = shapes.builtin_shape("S", 0.5, 31)
START = shapes.builtin_shape("I", 0.5, 31)
PATH = np.array([[0.4, 0.0, 0.01], [0.5, 0.0, 0.1], [0.5, 0.1, 0.01]])
FIRST = CorrectionRecord(x_m=0.03, y_m=0.04, z_m=0.0, yaw_rad=0.2, before_m=0.0321, predicted_m=0.0222, seen_m=0.0256)
UNSEEN = CorrectionRecord(x_m=0.0, y_m=0.0, z_m=0.0, yaw_rad=0.0, before_m=0.0256, predicted_m=0.0211)


def _record(count: int, *, predicted: bool = True) -> RunRecord:
    rows = tuple(
        made_action(number, rmse_m=0.020 / number, predicted_rmse_m=0.015 if predicted else None)
        for number in range(1, count + 1)
    )
    result = made_run(rows, outcome=RunOutcome.BUDGET, threshold_m=0.005, sim_time_s=1.0)
    shape = made_record(START, expected_world=GOAL if predicted else None, path_world=PATH)
    return RunRecord(name="I to S", result=result, goal_nodes_world=GOAL, actions=(shape,) * count)


def _texts(svg: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def _controlled(*corrections: CorrectionRecord, end: str = "no_gain") -> RunRecord:
    record = _record(2)
    rows = (msgspec.structs.replace(record.result.history[0], corrections=corrections, control_end=end),)
    return replace(record, result=msgspec.structs.replace(record.result, history=rows + record.result.history[1:]))


@pytest.mark.parametrize(("count", "across"), [(1, 1), (2, 2), (3, 3), (5, 3), (12, 4)])
def test_every_action_has_a_view_and_few_views_fill_one_row(count: int, across: int) -> None:
    svg = figures.expected_shapes(_record(count))
    titles = [text for text in _texts(svg) if re.fullmatch(r"\d+: drag", text)]
    assert titles == [f"{number}: drag" for number in range(1, count + 1)]
    assert figures.views_across(count) == across


def test_of_a_long_run_the_last_views_are_shown() -> None:
    texts = _texts(figures.expected_shapes(_record(14)))
    assert "2: drag" not in texts
    assert {"3: drag", "14: drag"} <= set(texts)


def test_the_views_share_one_legend() -> None:
    texts = _texts(figures.expected_shapes(_record(3)))
    assert [text for text in texts if not text.endswith("drag")] == ["goal", "tool", "expected", "achieved"]


def test_a_view_of_an_action_that_was_not_predicted_has_no_expected_shape() -> None:
    assert "expected" not in _texts(figures.expected_shapes(_record(1, predicted=False)))


def test_every_predicted_action_is_a_numbered_point_between_the_axes() -> None:
    record = _record(3)
    rows = (record.result.history[0], made_action(2, rmse_m=0.010), record.result.history[2])
    texts = _texts(
        figures.expected_errors(replace(record, result=msgspec.structs.replace(record.result, history=rows)))
    )
    assert "1" in texts
    assert "3" in texts
    assert "expected RMSE [mm]" in texts
    assert texts.count("2") == 0


def test_actions_without_a_prediction_make_no_section() -> None:
    assert "Expected and achieved" in report_html(_record(1))
    assert "Expected and achieved" not in report_html(_record(1, predicted=False))


def test_each_correction_is_listed_with_predicted_and_observed_gain() -> None:
    page = report_html(_controlled(FIRST, UNSEEN))
    for text in ("Control while the DLO was held", "50.0 mm", "11.5°", "32.1 mm", "22.2 mm", "25.6 mm", "no gain"):
        assert text in page, text


def test_a_correction_whose_effect_was_not_seen_has_no_point_for_it() -> None:
    def points(*corrections: CorrectionRecord) -> int:
        return figures.control_errors(_controlled(*corrections)).count("<use ")

    seen = msgspec.structs.replace(UNSEEN, seen_m=0.02)
    assert points(FIRST, seen) == points(FIRST, UNSEEN) + 1


def test_control_that_ended_at_once_has_its_reason_and_no_plot() -> None:
    page = report_html(_controlled(end="badly_seen"))
    assert "ended: badly seen" in page
    assert "before and after each correction" not in page


def test_an_action_without_control_has_the_reason() -> None:
    assert "planned alone, control was not worth it" in report_html(_controlled(end="not_worth_it"))


def test_a_run_without_control_has_no_such_section() -> None:
    assert "Control while" not in report_html(_record(2))


def test_every_view_from_above_names_the_fixtures() -> None:
    record = replace(_record(2), fixtures=FURNISHED.fixtures)
    verdict = GoalVerdict(stamp_ns=0, standing=Standing.DOUBTFUL, threshold_m=0.012, goal_world=GOAL, releases=())

    def names(svg: str) -> list[str]:
        return [text for text in _texts(svg) if text in ("A", "lid")]

    assert names(figures.overlay(record)) == ["A", "lid"]
    assert names(figures.spring_back(verdict, record.fixtures)) == ["A", "lid"]
    assert sorted(names(figures.expected_shapes(record))) == ["A", "A", "lid", "lid"]
    assert names(figures.overlay(replace(record, fixtures=()))) == []


def test_a_fixture_is_drawn_by_its_outline_with_its_name_below() -> None:
    _, axes = new_figure(4.0, 4.0)
    draw_fixtures(axes, FURNISHED.fixtures)
    for patch, text, fixture in zip(axes.patches, axes.texts, FURNISHED.fixtures, strict=True):
        np.testing.assert_allclose(np.asarray(patch.get_path().vertices)[:-1], outline_xy(fixture))
        assert text.get_text() == fixture.name
