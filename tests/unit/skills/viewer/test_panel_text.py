import re
from html import escape
from typing import get_args

import msgspec
import numpy as np

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.palette import TERMS, term
from dlokit.skills.viewer.panel.controls import end_html, hints_html
from dlokit.skills.viewer.panel.operation import Situation, page_state
from dlokit.skills.viewer.panel.panel import candidates_html, goal_html, key_html, legend_html, status_html
from dlokit.skills.viewer.state import RunState
from dlokit.types.action import Action, Candidates, ScoredCandidate
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import FlowStatus, Mode, RunOutcome, RunPhase, RunStatus, TaskEnd


def _text(html: str) -> str:
    """What people read, without markup."""
    return re.sub(r"<[^>]*>", "", html)


def _status(text: str = "", outcome: RunOutcome | None = None) -> FlowStatus:
    return FlowStatus(
        stamp_ns=1, flow="shape", step="choose_grasp", actions=3, rmse_m=0.0213, text=text, outcome=outcome
    )


def test_a_running_task_shows_step_actions_error_and_threshold() -> None:
    text = _text(status_html(RunState.RUNNING, _status(), 0.012))
    assert "choose grasp" in text
    assert "3 actions · last RMSE 21.3 mm · threshold 12.0 mm" in text


def test_one_action_is_singular() -> None:
    html = status_html(RunState.RUNNING, msgspec.structs.replace(_status(), actions=1), 0.012)
    assert "1 action · " in _text(html)


def test_each_word_of_the_field_has_a_tooltip() -> None:
    html = status_html(RunState.RUNNING, msgspec.structs.replace(_status(), mode=Mode.CONTROL), 0.012)
    for word in ("actions", "RMSE", "threshold", "control mode"):
        assert f'title="{escape(TERMS[word], quote=True)}"' in html
    kinds = {str(kind.__struct_config__.tag) for kind in get_args(Action)}
    assert kinds <= TERMS.keys()
    assert term("<b>") == "&lt;b&gt;"


def test_an_ended_task_shows_its_outcome_and_a_paused_one_that_it_is_paused() -> None:
    assert ">stalled<" in status_html(RunState.ENDED, _status(outcome=RunOutcome.STALLED), 0.012)
    assert ">paused<" in status_html(RunState.PAUSED, _status(), 0.012)


def test_the_mode_of_a_step_is_shown_while_the_task_runs_and_no_longer() -> None:
    controlling = msgspec.structs.replace(_status(), mode=Mode.CONTROL)
    assert 'data-mode="control"' in status_html(RunState.RUNNING, controlling, 0.012)
    assert "data-mode" not in status_html(RunState.RUNNING, _status(), 0.012)
    assert "data-mode" not in status_html(RunState.PAUSED, controlling, 0.012)


def test_text_from_the_flow_cannot_become_markup() -> None:
    assert "<script>" not in status_html(RunState.RUNNING, _status("<script>alert(1)</script>"), 0.012)


def test_a_decision_shows_its_progress_and_the_best_candidates_best_first() -> None:
    nodes = np.zeros((2, 3))
    best = tuple(
        ScoredCandidate(kind=kind, node=node, score_m=score_m, nodes_world=nodes, path_world=nodes)
        for kind, node, score_m in (("lay-down", 0, 0.0123), ("<drag>", 7, 0.0456))
    )
    html = candidates_html(Candidates(stamp_ns=1, rollouts=96, budget=480, best=best))
    assert "96 of 480 rollouts" in _text(html)
    assert html.index("12.3 mm") < html.index("45.6 mm")
    assert html.index("node 0") < html.index("node 7")
    assert "&lt;drag&gt;" in html
    assert "A score is larger than the expected RMSE" in _text(html)
    assert "<table" not in candidates_html(Candidates(stamp_ns=1, rollouts=0, budget=480))


def test_the_legend_names_every_layer_in_its_colour() -> None:
    html = legend_html(palette.LAYERS)
    for layer in palette.LAYERS:
        assert layer.title in html
        assert palette.css(layer.color) in html


def test_no_two_layers_share_a_colour() -> None:
    assert len({layer.color for layer in palette.LAYERS}) == len(palette.LAYERS)


def test_the_key_of_the_scene_names_what_is_shown_and_nothing_else() -> None:
    html = key_html((palette.STATE, palette.GOAL))
    assert _text(html) == "Model stateGoal"
    assert key_html(()) == ""


def test_the_card_of_an_ended_task_says_each_figure_once() -> None:
    end = TaskEnd(
        number=2,
        goal="S",
        outcome=RunOutcome.DRY_RUN,
        text="It passes A.",
        actions=1,
        rmse_m=0.0071,
        threshold_m=0.012,
        files=("task-2/report.html",),
    )
    text = _text(end_html(end, served=True))
    for words in ("Task 2, to S: dry run", "1 action · RMSE 7.1 mm · threshold 12.0 mm", "It passes A.", "report.html"):
        assert text.count(words) == 1
    assert "RMSE –" in _text(end_html(msgspec.structs.replace(end, rmse_m=None), served=True))


def test_an_ended_run_lists_its_files_without_links_and_their_folder() -> None:
    end = TaskEnd(
        number=2,
        goal="S",
        outcome=RunOutcome.CONVERGED,
        text="",
        actions=1,
        rmse_m=0.0071,
        threshold_m=0.012,
        folder="/home/a/runs/b",
        files=("task-2/report.html", "task-2/goal.csv"),
    )
    assert end_html(end, served=True).count("<a ") == 2
    ended = end_html(end, served=False)
    assert "<a " not in ended
    assert "report.html · goal.csv" in _text(ended)
    for html in (ended, end_html(end, served=True)):
        assert "/home/a/runs/b/task-2" in _text(html)


def test_an_ended_task_has_its_own_error() -> None:
    assert "last RMSE" not in _text(status_html(RunState.ENDED, _status(outcome=RunOutcome.STALLED), 0.012))
    assert "last RMSE 21.3 mm" in _text(status_html(RunState.ENDED, _status(outcome=RunOutcome.CANCELLED), 0.012))
    unknown = msgspec.structs.replace(_status(), rmse_m=None)
    assert "last RMSE" not in _text(status_html(RunState.RUNNING, unknown, 0.012))


def test_the_goal_is_named_with_its_verdict_and_before_it() -> None:
    goal = GoalShape(stamp_ns=1, nodes_world=np.zeros((2, 3)), name="/home/a/curve.csv")
    assert _text(goal_html(goal, None)) == "Goal: curve.csv"
    dragged = msgspec.structs.replace(goal, name="frames")
    assert "Goal: dragged – The goal is doubtful." in _text(goal_html(dragged, _verdict(Standing.DOUBTFUL)))


def test_a_goal_that_holds_does_not_sound_as_if_it_were_reached() -> None:
    goal = GoalShape(stamp_ns=1, nodes_world=np.zeros((2, 3)), name="S")
    assert "Once in this shape" in _text(goal_html(goal, _verdict(Standing.HOLDS)))
    assert "Once in this shape" not in _text(goal_html(goal, _verdict(Standing.DOUBTFUL)))


def _verdict(standing: Standing) -> GoalVerdict:
    return GoalVerdict(stamp_ns=1, standing=standing, threshold_m=0.012, goal_world=np.zeros((2, 3)))


def test_shape_it_has_no_tooltip_over_the_status_of_the_task_that_it_started() -> None:
    running = page_state(Situation(run=RunStatus(stamp_ns=1, phase=RunPhase.RUNNING), goal_set=True))
    waiting = page_state(Situation(run=RunStatus(stamp_ns=1, phase=RunPhase.WAITING), goal_set=True))
    assert ".icon-tabler-wand" in hints_html(waiting)
    assert ".icon-tabler-wand" not in hints_html(running)


def test_a_tooltip_cannot_leave_its_style_sheet() -> None:
    run = RunStatus(stamp_ns=1, phase=RunPhase.WAITING)
    html = hints_html(page_state(Situation(run=run, goal_set=True, lost=('x"}</style><b>\\',))))
    assert (html.count("<"), html.count("</style>")) == (2, 1)
    assert "\\22 }\\3c /style>\\3c b>\\5c ;" in html
