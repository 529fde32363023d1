import msgspec

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.panel import legend_html, status_html
from dlokit.skills.viewer.run_state import RunState
from dlokit.types.flow import FlowStatus, Mode, RunOutcome


def _status(text: str = "", outcome: RunOutcome | None = None) -> FlowStatus:
    return FlowStatus(
        stamp_ns=1, flow="shape", step="choose_grasp", actions=3, rmse_m=0.0213, text=text, outcome=outcome
    )


def test_a_running_task_shows_its_step_actions_and_error_against_the_threshold() -> None:
    html = status_html(RunState.RUNNING, _status(), 0.012)
    assert "choose grasp" in html
    assert "3 actions · RMSE 21.3 mm · threshold 12.0 mm" in html


def test_an_ended_task_shows_its_outcome_and_a_pausing_one_that_it_pauses() -> None:
    assert ">stalled<" in status_html(RunState.ENDED, _status(outcome=RunOutcome.STALLED), 0.012)
    assert ">paused<" in status_html(RunState.PAUSED, _status(), 0.012)


def test_the_mode_of_a_step_is_shown_while_the_task_runs_and_no_longer() -> None:
    controlling = msgspec.structs.replace(_status(), mode=Mode.CONTROL)
    assert 'data-mode="control"' in status_html(RunState.RUNNING, controlling, 0.012)
    assert "data-mode" not in status_html(RunState.RUNNING, _status(), 0.012)
    assert "data-mode" not in status_html(RunState.PAUSED, controlling, 0.012)


def test_text_from_the_flow_cannot_become_markup() -> None:
    assert "<script>" not in status_html(RunState.RUNNING, _status("<script>alert(1)</script>"), 0.012)


def test_the_legend_names_every_layer_in_its_colour() -> None:
    html = legend_html(palette.LAYERS)
    for layer in palette.LAYERS:
        assert layer.title in html
        assert palette.css(layer.color) in html


def test_no_two_layers_share_a_colour() -> None:
    assert len({layer.color for layer in palette.LAYERS}) == len(palette.LAYERS)
