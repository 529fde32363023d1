import base64
import re
from dataclasses import replace
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from loaded_elsewhere import loaded_elsewhere
from made_results import made_action, made_record, made_run

from dlokit.app.report import figures
from dlokit.app.report.page import report_html, write_report
from dlokit.app.shape.outcome_text import explain_outcome
from dlokit.description import shapes
from dlokit.description.passing import parse_wish, passing
from dlokit.description.scene import Post
from dlokit.system.results.run_result import CameraResult, RunRecord, StepTiming, TaskSummary
from dlokit.types.feasibility import GoalVerdict, Release, Standing
from dlokit.types.flow import RunOutcome

GOAL = shapes.builtin_shape("S", 0.5, 31)
START = shapes.builtin_shape("I", 0.5, 31)
VOID = {"meta", "img", "path", "use", "rect"}  # elements that are not closed, or close themselves


class _Balance(HTMLParser):
    """Collects opened and closed elements, and all references to external resources."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._attributes(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._attributes(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def _attributes(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.references += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]
        self.ids += [value or "" for name, value in attrs if name == "id"]


def _parse(page: str) -> _Balance:
    parser = _Balance()
    parser.feed(page)
    return parser


@pytest.fixture(scope="module")
def record() -> RunRecord:
    history = (
        made_action(
            1, "lay-down", grasp_ok=True, rmse_m=0.0311, true_rmse_m=0.0322, duration_s=11.0, robot_time_s=10.0
        ),
        made_action(2, "drag", grasp_ok=False, rmse_m=0.0311, duration_s=6.0, robot_time_s=5.0),
        made_action(
            3, "pick-and-place", grasp_ok=True, rmse_m=0.0088, true_rmse_m=0.0099, duration_s=12.0, robot_time_s=11.0
        ),
    )
    result = made_run(history, rmse_m=0.0088, true_rmse_m=0.0099, sim_time_s=40.0)
    between = shapes.moved((START + GOAL) / 2, (0.0, 0.01))
    picture = np.zeros((56, 64, 3), dtype=np.uint8)
    picture[:, :32] = (200, 30, 10)
    return RunRecord(
        name="I to S",
        result=result,
        goal_nodes_world=GOAL,
        start_nodes_world=START,
        actions=(
            made_record(between, release_stamp_ns=1),
            made_record(between),
            made_record(GOAL, release_stamp_ns=2),
        ),
        timings={
            "look": StepTiming(calls=4, sim_time_s=2.0, wall_time_s=1.5),
            "clear_marks": StepTiming(calls=2, sim_time_s=0.0, wall_time_s=0.001),
            "move_to_goal": StepTiming(calls=3, sim_time_s=20.0, wall_time_s=9.0),
        },
        image_before=picture,
        image_after=picture[::-1].copy(),
        config_toml='name = "<rope> & co"\n',
        command="dlokit shape --start I --goal S --seed 4",
        machine={"mujoco": "4.0.0"},
        verdict=GoalVerdict(
            stamp_ns=0,
            standing=Standing.HOLDS,
            threshold_m=0.012,
            goal_world=GOAL,
            releases=tuple(
                Release(elastic_factor=factor, nodes_world=GOAL, rmse_m=0.001, node=30, largest_m=0.002)
                for factor in (1.0, 2.5, 0.4)
            ),
        ),
    )


def test_the_page_is_well_formed_and_self_contained(record: RunRecord) -> None:
    html = report_html(record)
    page = _parse(html)

    assert loaded_elsewhere(html) == []
    assert page.open == []
    assert not page.tags & {"script", "link", "iframe"}
    assert all(reference.startswith(("#", "data:")) for reference in page.references)
    assert len(page.ids) == len(set(page.ids))
    assert {reference[1:] for reference in page.references if reference.startswith("#")} <= set(page.ids)


def test_the_page_has_the_sides_of_posts_and_the_outcome_names_what_is_not_as_wished(record: RunRecord) -> None:
    posts = tuple(Post(name=name, position_m=(x_m, 0.0, 0.0)) for name, x_m in (("A", 0.54), ("B", 0.60)))
    found = passing(START, posts, parse_wish("-A", posts))
    true = passing(START, posts, parse_wish("+A", posts), unsure_m=0.0)
    result = msgspec.structs.replace(record.result, passing=found, true_passing=true)
    html = report_html(replace(record, result=result))

    assert _parse(html).open == []
    table = html[html.index("<h2>Posts</h2>") : html.index("</section>", html.index("<h2>Posts</h2>"))]
    for text in ("<td>A</td><td>clockwise</td>", "counterclockwise", 'class="no">no</td>', "20.0 mm", "<td>B</td>"):
        assert text in table
    assert "Not as wished: the DLO passes A clockwise." in html
    assert "It passes A clockwise, as wished." in explain_outcome(msgspec.structs.replace(result, passing=true))
    assert "<h2>Posts</h2>" not in report_html(record)


def test_every_row_of_the_table_of_posts_is_whole_where_a_believed_post_truly_is_not_there(record: RunRecord) -> None:
    posts = tuple(Post(name=name, position_m=(x_m, 0.0, 0.0)) for name, x_m in (("A", 0.54), ("B", 0.60)))
    result = msgspec.structs.replace(
        record.result, passing=passing(START, posts), true_passing=passing(START, posts[:1], unsure_m=0.0)
    )
    html = report_html(replace(record, result=result))

    table = html[html.index("<h2>Posts</h2>") : html.index("</section>", html.index("<h2>Posts</h2>"))]
    _, *rows = table.split("<tr>")[1:]
    assert [row.count("<td") for row in rows] == [table.count("<th>")] * 2


def test_the_page_has_outcome_figures_actions_and_setup(record: RunRecord) -> None:
    page = report_html(record)

    for text in (
        *("I to S", "converged", "8.8 mm", "9.9 mm", "31.1 mm", "lay-down", "not held", "12 mm", "2.0× real time"),
        *("dlokit shape --start I --goal S --seed 4", "0123456789ab", "mujoco", "4.0.0", "move to goal (3×)"),
    ):
        assert text in page, text
    assert page.count('class="met"') == 1
    assert re.findall(r"<td>(\d\.\d\d) ×</td>", page) == ["0.40", "1.00", "2.50"]


def test_configuration_and_names_are_escaped(record: RunRecord) -> None:
    page = report_html(replace(record, name="<b>goal</b>", command="<b>again</b>", machine={"<b>os</b>": "<b>1</b>"}))

    assert "&lt;rope&gt; &amp; co" in page
    assert not any(f"<b>{word}" in page for word in ("goal", "again", "os", "1<"))


def test_images_are_embedded_with_their_colours(record: RunRecord) -> None:
    encoded = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', report_html(record))

    pictures = [cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR) for data in encoded]
    assert len(pictures) == 2
    assert pictures[0] is not None
    # OpenCV reads BGR; JPEG of this quality is right to a few counts.
    np.testing.assert_allclose(pictures[0][28, 8], (10, 30, 200), atol=4)


def test_figures_take_their_colours_from_the_page_so_that_dark_mode_applies(record: RunRecord) -> None:
    for figure in (
        figures.overlay(record),
        figures.error_curve(record),
        figures.timing_bars(record.timings),
    ):
        assert "var(--final)" in figure
        assert "#0" not in figure.replace('"#', '"')  # no placeholder is left
        assert "#000000" not in figure


def test_every_shape_is_drawn(record: RunRecord) -> None:
    overlay = figures.overlay(record)
    short = msgspec.structs.replace(record.result, history=record.result.history[:2])
    fewer = figures.overlay(replace(record, actions=record.actions[:2], result=short))

    assert overlay.count("var(--step)") == fewer.count("var(--step)") + 1  # the final shape has a colour of its own
    for variable in ("--goal", "--start", "--final"):
        assert f"var({variable})" in overlay


def test_short_steps_are_named_but_not_drawn(record: RunRecord) -> None:
    assert "Steps that took less than 0.02 s in total: clear marks (2×)." in report_html(record)
    assert "clear marks" not in figures.timing_bars(record.timings)


def test_the_time_of_a_step_beside_that_of_the_run_is_wall_time_for_it_contains_waits_and_motions(
    record: RunRecord,
) -> None:
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", figures.timing_bars(record.timings))
    assert {"run&#x27;s clock", "wall time"} <= set(texts) or {"run's clock", "wall time"} <= set(texts)
    assert "computing" not in texts


def test_a_true_error_is_drawn_over_the_estimate_which_it_mostly_equals(record: RunRecord) -> None:
    curve = figures.error_curve(record)
    lines = re.findall(r'id="[^"]*line2d[^"]*">\s*<path [^>]*style="([^"]*)"', curve)
    order = [name for style in lines for name in ("--final", "--truth") if f"stroke: var({name})" in style]
    assert order[:2] == ["--final", "--truth"]


def test_words_in_the_table_of_actions_are_aligned_to_the_left_and_the_command_is_not_cut_off(
    record: RunRecord,
) -> None:
    page = report_html(record)
    assert '<th class="text">kind</th>' in page
    assert '<td class="text">lay-down</td>' in page
    assert '<td class="text no">not held</td>' in page
    assert '<pre class="command">dlokit shape' in page
    assert "pre.command { white-space: pre-wrap;" in page


def test_every_action_is_an_arrow_with_its_number(record: RunRecord) -> None:
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", figures.overlay(record))
    unseen = re.findall(r"<text[^>]*>([^<]*)</text>", figures.overlay(replace(record, start_nodes_world=None)))

    assert [text for text in texts if text.isdecimal()] == ["1", "2", "3"]
    assert "action, with its number" in texts
    assert [text for text in unseen if text.isdecimal()] == ["2", "3"]  # where the first came from is not known


def test_the_threshold_and_the_start_are_in_the_error_curve(record: RunRecord) -> None:
    curve = figures.error_curve(record)

    assert "threshold 12 mm" in curve
    assert "grasp not held" in curve
    assert "true, 2 s after release" in curve


def test_equal_runs_give_equal_pages(record: RunRecord) -> None:
    assert report_html(record) == report_html(record)


@pytest.mark.parametrize("outcome", [RunOutcome.FAILED, RunOutcome.CONVERGED])
def test_a_run_without_any_action_picture_or_estimate_has_a_page(record: RunRecord, outcome: RunOutcome) -> None:
    result = msgspec.structs.replace(
        record.result, outcome=outcome, reason="out_of_view", actions=0, rmse_m=None, true_rmse_m=None, history=()
    )
    bare = RunRecord(name="I to S", result=result, goal_nodes_world=GOAL)

    page = report_html(bare)

    assert _parse(page).open == []
    assert "without any action" in page
    assert "out of view" in page
    assert "No picture" in page
    assert "Error against actions" not in page


def test_a_task_that_was_stopped_in_its_first_action_has_the_error_before_it_and_no_true_one(record: RunRecord) -> None:
    result = msgspec.structs.replace(
        record.result, outcome=RunOutcome.CANCELLED, actions=1, rmse_m=0.1522, true_rmse_m=0.3084, history=()
    )
    page = report_html(replace(record, result=result, actions=()))

    assert "<b>152.2 mm</b><span>RMSE to the goal, estimated, before action 1</span>" in page
    assert "<b>1</b><span>action, not finished</span>" in page
    assert "The task was stopped before its end." in page
    assert "The task ended during action 1, so its effect was not measured." in page
    assert "308.4" not in page
    assert "without any action" not in page


def test_a_task_that_was_stopped_in_a_later_action_says_which_action_its_figures_are_before(record: RunRecord) -> None:
    result = msgspec.structs.replace(record.result, outcome=RunOutcome.CANCELLED, actions=4)
    page = report_html(replace(record, result=result))

    assert "estimated, before action 4" in page
    assert "true, 2 s after the last release, before action 4, which was not finished" in page
    assert "<b>4</b><span>actions, the last not finished</span>" in page
    assert "<b>3</b><span>actions</span>" in report_html(record)


def test_the_report_of_a_task_is_titled_by_the_task_and_its_goal_and_names_its_run_and_its_time(
    record: RunRecord,
) -> None:
    result = msgspec.structs.replace(record.result, task=2, goal="S", wall_time_s=63.0)
    made = replace(
        record,
        name="I to interactive",
        folder="20261129-164035-I-to-interactive",
        began=datetime(2026, 11, 29, 16, 48, 10),
        result=result,
    )
    page = report_html(made)

    assert "<title>Task 2: to S – 20261129-164035-I-to-interactive – dlokit</title>" in page
    assert "<h1>Task 2: to S</h1>" in page
    origin = " ".join(page[page.index('class="origin"') :].partition("</p>")[0].split())
    assert (
        "Task 2 of the run <code>20261129-164035-I-to-interactive</code>, 2026-11-29, 16:48:10 to 16:49:13." in origin
    )
    assert "It started from the shape in which the camera saw the DLO after task 1." in origin
    assert "I to interactive</h1>" not in page
    assert "the command does not set it" not in page
    assert "the command does not set it" in report_html(replace(made, start_nodes_world=None))
    assert "Tasks of this run" not in page


def test_the_report_of_a_run_of_one_task_has_its_time_and_its_folder(record: RunRecord) -> None:
    made = replace(record, folder="20261129-164035-I-to-S", began=datetime(2026, 11, 29, 23, 59, 50))
    page = report_html(made)

    assert "<title>I to S – 20261129-164035-I-to-S – dlokit</title>" in page
    assert "Run <code>20261129-164035-I-to-S</code>, 2026-11-29, 23:59:50 to 00:00:10." in page


def test_the_report_of_a_run_of_several_tasks_is_that_of_the_last_and_lists_all_with_links(record: RunRecord) -> None:
    tasks = (
        TaskSummary(
            number=1, goal="drawn", outcome=RunOutcome.CONVERGED, actions=2, rmse_m=0.0077, report="task-1/r.html"
        ),
        TaskSummary(number=2, goal="", outcome=RunOutcome.CANCELLED, actions=1, unfinished=True, rmse_m=0.1522),
    )
    result = msgspec.structs.replace(record.result, task=2, tasks=tasks)
    page = report_html(replace(record, name="I to interactive", result=result))

    assert _parse(page).open == []
    assert "<h1>I to interactive: task 2 of 2, no goal</h1>" in page
    assert "This page is the report of the last task, number 2." in page
    listed = page[page.index("Tasks of this run") : page.index("</section>")]
    for text in (
        '<a href="task-1/r.html">task 1</a>',
        "drawn",
        "converged",
        "7.7 mm",
        "<td>task 2</td>",
        "cancelled",
        "152.2 mm, before action 1",
    ):
        assert text in listed, text


def test_the_page_is_written_into_the_runs_folder(record: RunRecord, tmp_path: Path) -> None:
    path = write_report(tmp_path, report_html(record))

    assert path == tmp_path / "report.html"
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_the_page_has_the_result_of_the_camera_check(record: RunRecord) -> None:
    text = "the camera was 3.4 mm & 0.10° off"
    told = replace(record, result=msgspec.structs.replace(record.result, camera=CameraResult(text=text)))
    assert "The camera was 3.4 mm &amp; 0.10° off." in report_html(told)
    assert "The camera was" not in report_html(record)


def test_shapes_and_pictures_come_first_then_what_made_them_and_the_verdict_last(record: RunRecord) -> None:
    made = replace(record, parts={"arm": "a Panda", "planner": "<b>rollout</b>"}, changed={"task.threshold_m": "0.02"})
    page = report_html(made)

    assert _parse(page).open == []
    headings = [heading.partition(" <")[0] for heading in re.findall(r"<h2>(.*?)</h2>", page)]
    assert headings[:5] == [
        *("Shapes on the table, from above", "Before the task", "After the task", "What shaped it"),
        "Settings that differ from the defaults",
    ]
    assert headings[-1] == "Can the goal hold?"
    for text in ("a Panda", "&lt;b&gt;rollout&lt;/b&gt;", "<code>task.threshold_m</code>", "<td>0.02</td>"):
        assert text in page
    # The columns of the verdict's table are explained above it.
    explained = page[page.index('id="verdict"') : page.index("springs back, RMSE")]
    assert "1.00 × is the believed ratio" in explained


def test_a_goal_that_may_not_hold_is_said_at_the_top_with_a_link_to_the_verdict(record: RunRecord) -> None:
    assert record.verdict is not None
    doubtful = replace(record, verdict=msgspec.structs.replace(record.verdict, standing=Standing.DOUBTFUL))
    page = report_html(doubtful)

    assert page.index('href="#verdict"') < page.index("Shapes on the table")
    assert 'href="#verdict"' not in report_html(record)


def test_a_run_with_the_defaults_says_so(record: RunRecord) -> None:
    page = report_html(record)
    assert page.index("None.") < page.index("<h2>Actions</h2>")
