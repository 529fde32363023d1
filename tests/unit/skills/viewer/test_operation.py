import itertools

import msgspec
import pytest

from dlokit.skills.viewer.panel.operation import (
    FEWEST_FRAMES,
    MOST_FRAMES,
    Button,
    PageState,
    Situation,
    page_state,
)
from dlokit.types.feasibility import Standing
from dlokit.types.flow import RunOutcome, RunPhase, RunStatus, TaskEnd

ENDED = TaskEnd(
    number=2, goal="S", outcome=RunOutcome.STALLED, text="no progress", actions=3, rmse_m=0.02, threshold_m=0.012
)


def _page(
    phase: RunPhase,
    *,
    paused: bool = False,
    asks: str = "",
    notice: str = "",
    last: TaskEnd | None = None,
    stop_latched: bool = False,
    goal_set: bool = True,
    standing: Standing | None = None,
    nearest: bool = False,
    lost: tuple[str, ...] = (),
    frames: int = 3,
    drawing: bool = False,
) -> PageState:
    run = RunStatus(stamp_ns=1, phase=phase, stays=True, paused=paused, asks=asks, notice=notice, last=last)
    return page_state(
        Situation(
            run=run,
            stop_latched=stop_latched,
            goal_set=goal_set,
            standing=standing,
            nearest=nearest,
            lost=lost,
            frames=frames,
            drawing=drawing,
        )
    )


def _enabled(page: PageState) -> set[Button]:
    return {button for button, state in page.buttons.items() if state.enabled}


@pytest.mark.parametrize(
    ("phase", "paused", "latched"), list(itertools.product(RunPhase, (False, True), (False, True)))
)
def test_stop_is_always_enabled_and_every_state_has_a_line_and_hints(
    phase: RunPhase, paused: bool, latched: bool
) -> None:
    page = _page(phase, paused=paused, stop_latched=latched, asks="carry" if phase is RunPhase.ASKING else "")
    assert Button.STOP in _enabled(page)
    assert page.headline
    assert page.advice
    assert set(page.buttons) == set(Button)
    silent = {button for button, state in page.buttons.items() if not state.hint}
    assert silent == ({Button.SHAPE} if phase is RunPhase.RUNNING and not latched else set())


@pytest.mark.parametrize(
    ("phase", "paused", "enabled"),
    [
        (RunPhase.STARTING, False, set[Button]()),
        (RunPhase.RUNNING, False, {Button.PAUSE}),
        (RunPhase.RUNNING, True, {Button.RESUME}),
        (RunPhase.PAUSED, True, {Button.RESUME}),
        (RunPhase.ASKING, False, {Button.PAUSE, Button.PROCEED}),
        (RunPhase.WAITING, False, {Button.SHAPE, Button.END}),
        (RunPhase.FINISHING, False, set[Button]()),
        (RunPhase.ENDED, False, set[Button]()),
    ],
)
def test_buttons_of_the_run_are_enabled_where_they_do_something(
    phase: RunPhase, paused: bool, enabled: set[Button]
) -> None:
    run = {Button.SHAPE, Button.PAUSE, Button.RESUME, Button.PROCEED, Button.ENABLE, Button.END}
    assert _enabled(_page(phase, paused=paused)) & run == enabled


def test_the_goal_can_be_changed_only_while_no_task_runs() -> None:
    assert _page(RunPhase.WAITING).editable
    assert {Button.SHAPES, Button.DRAW, Button.SEE, Button.LOAD} <= _enabled(_page(RunPhase.WAITING))
    for phase in set(RunPhase) - {RunPhase.WAITING}:
        page = _page(phase)
        assert not page.editable
        assert not {Button.SHAPES, Button.DRAW, Button.SEE, Button.LOAD, Button.UNDO} & _enabled(page)


@pytest.mark.parametrize(
    ("page", "why"),
    [
        (_page(RunPhase.PAUSED, paused=True), "paused"),
        (_page(RunPhase.ASKING), "waits for your answer"),
        (_page(RunPhase.ENDED), "has ended"),
        (_page(RunPhase.WAITING, goal_set=False), "No goal is set"),
        (_page(RunPhase.WAITING, stop_latched=True), "Enable arms"),
        (_page(RunPhase.WAITING, standing=Standing.INFEASIBLE, nearest=True), "nearest that holds"),
        (_page(RunPhase.WAITING, lost=("perception",)), "perception"),
    ],
)
def test_shape_it_says_why_it_does_nothing(page: PageState, why: str) -> None:
    shape = page.buttons[Button.SHAPE]
    assert not shape.enabled
    assert why in shape.hint


@pytest.mark.parametrize("standing", [None, Standing.HOLDS, Standing.DOUBTFUL])
def test_a_goal_that_may_hold_can_be_tried(standing: Standing | None) -> None:
    assert Button.SHAPE in _enabled(_page(RunPhase.WAITING, standing=standing))


def test_after_a_task_the_line_says_what_to_do_and_leaves_the_result_to_its_card() -> None:
    page = _page(RunPhase.WAITING, last=ENDED)
    assert page.headline == "Waiting for your next goal"
    assert "Shape it" in page.advice
    assert "stalled" not in page.headline + page.advice


def test_after_a_task_that_missed_its_goal_the_line_says_that_the_goal_is_still_set() -> None:
    assert "The goal stays set" in _page(RunPhase.WAITING, last=ENDED).advice
    reached = msgspec.structs.replace(ENDED, outcome=RunOutcome.CONVERGED)
    assert "stays" not in _page(RunPhase.WAITING, last=reached).advice


def test_a_task_without_a_goal_is_not_shaping_yet() -> None:
    page = _page(RunPhase.RUNNING, goal_set=False)
    assert page.headline == "Getting ready"
    assert "STOP" in page.advice
    assert _page(RunPhase.RUNNING).headline == "Shaping the DLO"


@pytest.mark.parametrize("phase", list(RunPhase))
@pytest.mark.parametrize("drawing", [False, True])
def test_the_line_says_that_the_arms_are_stopped_whatever_else_goes_on(phase: RunPhase, drawing: bool) -> None:
    page = _page(phase, stop_latched=True, drawing=drawing, lost=("model",), notice="No goal was taken", last=ENDED)
    assert page.headline == "The arms are stopped"
    assert "Enable arms" in page.advice
    assert page.urgent


def test_a_lost_component_is_said_also_while_a_goal_is_drawn() -> None:
    assert "perception" in _page(RunPhase.WAITING, drawing=True, lost=("perception",)).headline


def test_the_line_says_what_a_stopped_arm_a_lost_component_and_a_question_need() -> None:
    assert "Enable arms" in _page(RunPhase.RUNNING, stop_latched=True).advice
    assert "perception" in _page(RunPhase.RUNNING, lost=("perception",)).headline
    assert "carry the DLO" in _page(RunPhase.ASKING, asks="carry the DLO").headline
    assert _page(RunPhase.WAITING, notice="No goal was taken: no_points").advice == "No goal was taken: no_points"


def test_frames_are_added_and_removed_within_bounds() -> None:
    assert Button.MORE not in _enabled(_page(RunPhase.WAITING, frames=MOST_FRAMES))
    assert Button.FEWER not in _enabled(_page(RunPhase.WAITING, frames=FEWEST_FRAMES))
    assert {Button.MORE, Button.FEWER} <= _enabled(_page(RunPhase.WAITING, frames=FEWEST_FRAMES + 1))


def test_while_a_goal_is_drawn_the_one_before_cannot_be_started() -> None:
    page = _page(RunPhase.WAITING, drawing=True)
    assert page.headline == "Drawing a goal"
    assert Button.SHAPE not in _enabled(page)
    assert "finish the line, or press Esc" in page.buttons[Button.SHAPE].hint
    assert Button.STOP in _enabled(page)


def test_the_button_that_begins_a_drawing_says_how_to_leave_it() -> None:
    labels = [_page(RunPhase.WAITING, drawing=drawing).buttons[Button.DRAW].label for drawing in (False, True)]
    assert labels == ["Draw on the table", "Leave the drawing (Esc)"]
    assert "Esc leaves the drawing" in _page(RunPhase.WAITING, drawing=True).advice
