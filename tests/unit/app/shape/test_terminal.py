import asyncio
import io
import re
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from made_results import made_action, made_run
from rich.console import Console

from dlokit.app.console import say
from dlokit.app.shape.outcome_text import MEANINGS, explain_outcome, grip_text, when_true
from dlokit.app.shape.terminal import RunDisplay, action_table
from dlokit.decision.records import Recovery
from dlokit.system.results.run_result import CameraResult, RunRecord, VerdictResult
from dlokit.system.signals import LastResort
from dlokit.types.action import Candidates, ScoredCandidate
from dlokit.types.feasibility import Standing
from dlokit.types.flow import FlowStatus, RunOutcome

ROWS = (
    made_action(1, "lay-down", grasp_ok=True, rmse_m=0.0453, duration_s=11.34, robot_time_s=10.34),
    made_action(2, "drag", grasp_ok=False, rmse_m=0.0101, duration_s=9.0),
)
RESULT = made_run(ROWS, rmse_m=0.0101, true_rmse_m=0.0112)
STATUS = FlowStatus(stamp_ns=0, flow="shape_dlo", step="choose_grasp", rmse_m=0.0453, text="node 30")


def _console(*, terminal: bool) -> Console:
    return Console(
        file=io.StringIO(), force_terminal=terminal, width=100, color_system=None, _environ={"TERM": "xterm"}
    )


def _written(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def _show(console: Console, report: Path | None = None) -> str:
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(STATUS)
        for row in ROWS:
            display.action(row)
    display.finish(RESULT, report)
    return _written(console)


def test_a_terminal_shows_the_table_and_the_present_step() -> None:
    text = _show(_console(terminal=True))

    assert "choose grasp" in text
    assert "45.3 mm" in text
    assert "< 12.0 mm" in text
    assert "not held" in text
    assert "┃" in text


@pytest.mark.parametrize("terminal", [True, False])
def test_the_viewers_address_is_shown_once_it_can_be_opened_with_its_purpose(terminal: bool) -> None:
    console = _console(terminal=terminal)
    with RunDisplay(console, title="I to S", threshold_m=0.012, invitation="Drag the frames.") as display:
        assert "viewer" not in _written(console)
        display.page("http://127.0.0.1:8080")
    at, todo = (_written(console).index(line) for line in ("viewer: http://127.0.0.1:8080", "Drag the frames."))
    assert at < todo


def test_a_terminal_shows_that_the_run_is_starting_until_its_first_step() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="I to S", threshold_m=0.012, starts="its processes") as display:
        assert "▸ starting   its processes" in _written(console)
        before = len(_written(console))
        display.step(STATUS)
        assert "starting" not in _written(console)[before:]


@pytest.mark.parametrize("terminal", [True, False])
def test_a_run_that_a_signal_ends_says_what_happens_and_for_how_long_at_most(terminal: bool) -> None:
    limits, left = list[float](), list[str]()
    console = _console(terminal=terminal)
    resort = LastResort(
        partial(say, console), leave=left.append, after=lambda seconds, _: limits.append(seconds), now_s=lambda: 0.0
    )
    with RunDisplay(console, title="I to S", threshold_m=0.012, last_resort=resort) as display:
        display.step(STATUS)
        display.stopping("SIGINT (Ctrl-C)")
        assert "SIGINT (Ctrl-C): the arms brake, the system ends and the files are written;\n" in _written(console)
        assert f"some seconds, at most {limits[0]:g} s\n" in _written(console)
        assert "Ctrl-C again" not in _written(console)
        display.interrupted_again()
        assert "Ctrl-C again ends the program at once" in _written(console)
    assert left == []


def test_a_run_that_ends_waits_for_nothing_else() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="I to S", threshold_m=0.012, stays=True) as display:
        asyncio.run(display.ended(1, RunRecord(name="I to S", result=RESULT, goal_nodes_world=np.zeros((2, 3)))))
        before = len(_written(console))
        display.stopping("SIGINT (Ctrl-C)")
        last = _written(console)[before:]
    assert last.count("▸ ending") == len(re.findall("▸", last))


@pytest.mark.parametrize("terminal", [True, False])
def test_stopped_arms_are_said_until_they_are_enabled_with_how_to_do_it(terminal: bool) -> None:
    console = _console(terminal=terminal)
    with RunDisplay(console, title="I to S", threshold_m=0.012, stays=True, keep=_kept) as display:
        display.step(FlowStatus(stamp_ns=0, flow="shape_dlo", step="move_to_goal", rmse_m=0.152))
        before = len(_written(console))
        display.arms_stopped(True)
        stopped = _written(console)[before:]
        assert "the arms are stopped" in stopped
        assert "“Enable arms” on the page, or run dlokit enable" in " ".join(stopped.split())
        assert "move to goal" not in stopped
        asyncio.run(display.ended(1, RunRecord(name="I to S", result=RESULT, goal_nodes_world=np.zeros((2, 3)))))
        waiting = _written(console)[before + len(stopped) :]
        assert waiting.rindex("the arms are stopped") < waiting.rindex("waiting for the next goal")
        before = len(_written(console))
        display.arms_stopped(False)
        assert "the arms are stopped" not in _written(console)[before:]
        assert ("next goal" if terminal else "the arms are enabled") in _written(console)[before:]


def test_arms_that_stop_in_a_run_of_one_task_are_said_without_a_button_of_the_next() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(STATUS)
        display.arms_stopped(True)
    assert "the arms are stopped" in _written(console)
    assert "Enable" not in _written(console)


def test_the_tables_of_a_run_with_several_tasks_have_the_number_of_the_task() -> None:
    console = _console(terminal=True)
    record = RunRecord(name="I to interactive", result=RESULT, goal_nodes_world=np.zeros((2, 3)))
    with RunDisplay(console, title="I to interactive", threshold_m=0.012, stays=True, keep=_kept) as display:
        display.step(STATUS)
        display.action(ROWS[0])
        asyncio.run(display.ended(1, record))
        display.step(STATUS)
        display.action(ROWS[1])
    assert "I to interactive" not in _written(console)
    assert all(f"task {number}\n" in _clean(console) for number in (1, 2))


def test_a_terminal_shows_no_table_before_the_first_action() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(STATUS)
    assert "I to S" in _written(console)
    assert "┃" not in _written(console)


def test_an_error_of_before_the_action_is_named_so() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(FlowStatus(stamp_ns=0, flow="shape_dlo", step="move_to_goal", rmse_m=0.152))
    assert "move to goal   last error 152.0 mm" in _written(console)


def _kept(number: int, record: RunRecord) -> tuple[RunRecord, Path]:
    return record, Path("runs/one") / f"task-{number}"


def _clean(console: Console) -> str:
    return re.sub(r" +\n", "\n", _written(console))


def test_a_program_that_is_not_ours_to_end_gets_no_time_limit() -> None:
    console = _console(terminal=False)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.stopping("SIGINT (Ctrl-C)")
        display.interrupted_again()
    assert "some seconds" in _written(console)
    assert "at most" not in _written(console)
    assert "Ctrl-C again" not in _written(console)


def test_the_whole_table_fits_into_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80, color_system=None)
    rows = [
        msgspec.structs.replace(row, kind="pick-and-place", rmse_m=0.1234, true_rmse_m=0.1234, duration_s=123.4)
        for row in ROWS
    ]
    console.print(action_table(rows, threshold_m=0.012))
    for whole in ("pick-and-place", "not held", "123.4 mm", "123.4 s", "duration", "< 12.0 mm", "action"):
        assert whole in _written(console), whole


def test_the_table_is_whole_in_60_columns() -> None:
    rows = tuple(msgspec.structs.replace(row, kind="pick-and-place", true_rmse_m=0.1234) for row in ROWS)
    console = Console(file=io.StringIO(), width=60, color_system=None)
    RunDisplay(console, title="I to S", threshold_m=0.012).finish(msgspec.structs.replace(RESULT, history=rows))
    for whole in ("pick-and-place", "not held", "123.4 mm", "< 12.0 mm"):
        assert whole in _written(console), whole
    assert "…" not in _written(console)
    assert max(map(len, _written(console).splitlines())) <= 60


def test_a_decision_shows_its_progress_and_best_candidate_until_the_next_step() -> None:
    console = _console(terminal=True)
    best = ScoredCandidate(
        kind="drag", node=7, score_m=0.0123, nodes_world=np.zeros((2, 3)), path_world=np.zeros((2, 3))
    )
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(STATUS)
        display.considered(Candidates(stamp_ns=0, rollouts=48, budget=480))
        display.considered(Candidates(stamp_ns=0, rollouts=96, budget=480, best=(best,)))
        deciding = _written(console)
        display.step(STATUS)
        after = _written(console)[len(deciding) :]

    assert "48 of 480 rollouts" in deciding
    assert "96 of 480 rollouts, best: drag at node 7, score 12.3 mm" in " ".join(deciding.split())
    assert "rollouts" not in after


def test_a_log_file_does_not_get_the_progress_of_decisions() -> None:
    console = _console(terminal=False)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.considered(Candidates(stamp_ns=0, rollouts=48, budget=480))

    assert "rollouts" not in _written(console)


def test_the_step_is_removed_when_the_run_has_ended() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(STATUS)
        before = len(_written(console))

    assert "choose grasp" not in _written(console)[before:]


def test_a_log_file_gets_one_plain_line_anmade_action() -> None:
    lines = _show(_console(terminal=False)).splitlines()

    assert lines[0] == "I to S: threshold 12.0 mm"
    assert lines[1] == "action 1: lay-down, node 30 held, RMSE 45.3 mm, 11.3 s"
    assert lines[2] == "action 2: drag, node 7 not held, RMSE 10.1 mm, 9.0 s"
    assert not any("choose grasp" in line or "\x1b" in line for line in lines)


def test_the_summary_has_outcome_error_pace_and_the_path_of_the_report() -> None:
    report = Path("/somewhere/with a long name/" + "deep/" * 30 + "report.html")

    text = _show(_console(terminal=False), report)

    assert "converged" in text
    assert "true error 11.2 mm" in text
    assert "1.5 times real time" in text
    assert f"report: {report}\n" in text  # in one piece, however narrow the terminal


def test_brackets_in_names_and_reasons_are_shown_as_they_are() -> None:
    console = _console(terminal=True)
    with RunDisplay(console, title="goals[bold].npy:3", threshold_m=0.012):
        pass
    RunDisplay(console, title="", threshold_m=0.012).finish(msgspec.structs.replace(RESULT, reason="axis [x]"))

    assert "goals[bold].npy:3" in _written(console)
    assert "axis [x]" in _written(console)


def test_the_verdict_on_a_goal_that_may_not_hold_is_printed_as_it_is() -> None:
    verdict = VerdictResult(standing=Standing.DOUBTFUL, text="The goal is doubtful.")
    console = _console(terminal=False)
    RunDisplay(console, title="", threshold_m=0.012).finish(msgspec.structs.replace(RESULT, goal_verdict=verdict))
    assert "The goal is doubtful." in _written(console).splitlines()


def test_recoveries_of_an_arm_are_counted_by_reason() -> None:
    reasons = ("reflex", "lease_lost", "reflex")
    rows = tuple(Recovery(action=number, reason=reason) for number, reason in enumerate(reasons, start=1))
    console = _console(terminal=False)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        pass
    display.finish(msgspec.structs.replace(RESULT, recoveries=rows), None)
    assert "recovered  reflex 2 times, lease_lost 1 time" in _written(console)
    assert "recovered" not in _show(_console(terminal=False))


def test_a_run_that_raises_leaves_the_terminal_usable() -> None:
    console = _console(terminal=True)
    with pytest.raises(KeyboardInterrupt), RunDisplay(console, title="I to S", threshold_m=0.012):
        raise KeyboardInterrupt

    assert "\x1b[?25h" in _written(console)  # the cursor is shown again


@pytest.mark.parametrize("outcome", RunOutcome)
def test_every_outcome_has_a_text(outcome: RunOutcome) -> None:
    words = explain_outcome(msgspec.structs.replace(RESULT, outcome=outcome, reason="out_of_view"))

    assert words.startswith(MEANINGS[outcome])
    assert "Reason: out of view." in words
    assert "10.1 mm" in words


def test_the_text_states_whether_the_threshold_was_met() -> None:
    assert "below the threshold of 12 mm" in explain_outcome(RESULT)
    assert "above the threshold" in explain_outcome(msgspec.structs.replace(RESULT, rmse_m=0.02))
    assert "never observed" in explain_outcome(msgspec.structs.replace(RESULT, rmse_m=None, outcome=RunOutcome.FAILED))


def test_a_run_with_large_prediction_errors_names_the_commands_that_learn_the_dlo() -> None:
    rows = tuple(msgspec.structs.replace(ROWS[0], action=number, prediction_error_m=0.05) for number in (1, 2, 3))
    stalled = msgspec.structs.replace(RESULT, outcome=RunOutcome.STALLED, history=rows)
    words = explain_outcome(stalled)
    assert "50 mm (median) from their predictions" in words
    assert "--learn" in words
    assert "dlokit identify" in words
    slipped = tuple(msgspec.structs.replace(row, slipped=True) for row in rows)
    braked = tuple(msgspec.structs.replace(row, ended_by="lease_lost") for row in rows)
    for said in (
        msgspec.structs.replace(stalled, outcome=RunOutcome.CONVERGED),
        msgspec.structs.replace(stalled, history=rows[:1]),
        msgspec.structs.replace(stalled, history=slipped),
        msgspec.structs.replace(stalled, history=braked),
        msgspec.structs.replace(stalled, history=ROWS),
    ):
        assert "predicted" not in explain_outcome(said)


@pytest.mark.parametrize("terminal", [True, False])
def test_the_result_of_the_camera_check_is_written_once(terminal: bool) -> None:
    text = "the camera was 3.4 mm and 0.10° off its calibration along the table; corrected"
    console = _console(terminal=terminal)
    with RunDisplay(console, title="I to S", threshold_m=0.012) as display:
        display.step(FlowStatus(stamp_ns=0, flow="shape_dlo", step="find_dlo", text=text))
    while_running = _written(console)
    display.finish(msgspec.structs.replace(RESULT, camera=CameraResult(text=text)))
    assert _written(console)[len(while_running) :].count("3.4 mm") == (1 if terminal else 0)
    if not terminal:
        assert while_running.count("3.4 mm") == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "held"),
        ({"grasp_ok": False}, "not held"),
        ({"kind": "push"}, "pushed"),
        ({"slipped": True}, "slipped"),
        ({"slipped": True, "ended_by": "slipped"}, "slipped"),
        ({"ended_by": "lease_lost"}, "lease lost"),
        ({"kind": "push", "ended_by": "lost_commander"}, "lost commander"),
        ({"grasp_ok": False, "ended_by": "joint_limit"}, "joint limit"),
    ],
)
def test_the_end_of_an_action_is_named_by_its_cause(changes: dict[str, Any], words: str) -> None:
    assert grip_text(msgspec.structs.replace(made_action(1), **changes)) == words


def test_an_action_that_the_end_cut_short_is_counted_and_named() -> None:
    last = len(RESULT.history) + 1
    stopped = msgspec.structs.replace(RESULT, outcome=RunOutcome.CANCELLED, actions=last)
    assert f"It ended during action {last}; before that action, the nodes of the DLO were" in explain_outcome(stopped)
    assert "during" not in explain_outcome(RESULT)


def test_the_time_of_a_true_error_is_named_and_none_of_a_held_dlo_is_printed() -> None:
    released = made_run((made_action(1, true_rmse_m=0.010),), true_rmse_m=0.010)
    untouched = made_run((), true_rmse_m=0.074)
    assert when_true(released) == "2 s after the last release"
    assert when_true(msgspec.structs.replace(released, actions=2)).endswith(
        "release, before action 2, which was not finished"
    )
    assert when_true(untouched) == "at the end"
    assert when_true(msgspec.structs.replace(untouched, actions=1)) == ""
    assert when_true(msgspec.structs.replace(untouched, true_rmse_m=None)) == ""


def test_a_page_that_shows_the_figures_gets_the_explanation_without_them() -> None:
    words = explain_outcome(RESULT, figures=False)
    assert words.startswith("The DLO has reached the goal shape.")
    assert "RMSE" not in words
    assert "action" not in words


def test_who_stopped_a_run_is_named() -> None:
    stopped = msgspec.structs.replace(RESULT, outcome=RunOutcome.CANCELLED, reason="stopped by SIGTERM")
    words = explain_outcome(stopped)
    assert "Reason: stopped by SIGTERM." in words
    assert "operator" not in words
