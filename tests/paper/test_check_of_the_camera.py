"""The step before those of Fig. 6: an observation of the robot's own hand."""

import pytest
from ideal_lab import I, shape
from scripted_hardware import Lab

from dlokit.types.flow import FlowStatus, RunOutcome


def lab(**fails: list[str]) -> Lab:
    return Lab(nodes=I.copy(), checks_camera=True, fails=fails)


def test_the_hand_is_observed_in_two_places_before_the_rope_with_the_arm_out_of_view_in_between():
    said: list[str] = []

    def listen(status: FlowStatus) -> None:
        said.append(f"{status.step}: {status.text}")

    trace = shape(lab(), I, operator=listen)
    check = ["home", "note_background", "move_to", "see_hand", "move_to", "see_hand", "check_camera"]
    assert trace.calls[: len(check) + 2] == [*check, "home", "look"]
    assert ("check_camera", "corrected", "find_dlo") in trace.edges()
    camera = trace.result.camera
    assert camera is not None
    assert camera.check is not None
    assert camera.text == "the camera was 5.0 mm and 0.06° off its calibration along the table; corrected"
    assert [line for line in said if camera.text in line] == [f"find_dlo: {camera.text}"]


@pytest.mark.parametrize(
    ("skill", "reason"),
    [
        ("note_background", "camera_lost"),
        ("move_to", "table_collision"),
        ("see_hand", "robot_lost"),
        ("check_camera", "scattered"),
    ],
)
def test_a_failed_check_is_reported_and_the_task_continues_without_it(
    skill: str, reason: str, caplog: pytest.LogCaptureFixture
):
    trace = shape(lab(**{skill: [reason]}), I)
    assert ("check_camera", "kept", "find_dlo") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.camera is not None
    assert trace.result.camera.check is None
    assert reason in trace.result.camera.text
    assert reason in caplog.text


def test_an_arm_that_braked_on_its_own_is_recovered_and_commanded_again():
    trace = shape(lab(move_to=["lease_lost"]), I)
    assert ("check_camera", "corrected", "find_dlo") in trace.edges()
    first = trace.calls.index("move_to")
    assert trace.calls[first : first + 3] == ["move_to", "recover", "move_to"]


def test_an_arm_that_does_not_reach_home_ends_the_task_before_any_observation():
    trace = shape(lab(home=["robot_lost"]), I)
    assert ("check_camera", "failed", "failed") in trace.edges()
    assert "note_background" not in trace.calls
    assert trace.result.reason is not None
    assert "robot_lost" in trace.result.reason


def test_without_the_check_the_rope_is_observed_at_once():
    trace = shape(Lab(nodes=I.copy()), I)
    assert ("check_camera", "off", "find_dlo") in trace.edges()
    assert trace.calls[:2] == ["home", "look"]
    assert trace.result.camera is None
