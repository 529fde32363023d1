"""A person's stop is assessed by feedback and by the commander's attempts: each violation is named."""

from dataclasses import replace

import msgspec
import numpy as np
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.types.robot import RobotState
from parts.stops.attempts import Attempt
from parts.stops.press_verdict import REFUSED, TRIED, Press, StopReport, judged
from stops import press_figures, stops_hold

STATE = structs.replace(
    ARM_AT_REST,
    finger_width_m=0.02,
    holding=True,
    stop_latched=True,
)
REPORT = StopReport(confirmed_s=0.2, exit_code=0)
REFUSALS = tuple(Attempt(skill=key, began_s=0.0, ended_s=0.1, ended_as=REFUSED) for key in TRIED)


def verdict(
    *states: RobotState, report: StopReport = REPORT, attempts: tuple[Attempt, ...] = REFUSALS, goes_on: bool = True
) -> Press:
    return judged(report, (STATE, *states), attempts, exit_code=0, holds=True, goes_on=goes_on)


def test_an_arm_that_is_stopped_and_refuses_everything_is_correct() -> None:
    nearly = msgspec.structs.replace(STATE, q_rad=np.full(7, 0.01), finger_width_m=0.0203)
    press = verdict(nearly)
    assert press.wrong == ()
    assert (press.confirmed_s, press.moved_rad) == (0.2, 0.01)
    assert np.isclose(press.fingers_m, 0.0003)


def test_any_motion_is_named_even_if_it_returns() -> None:
    moved = msgspec.structs.replace(STATE, q_rad=np.array([0, 0, 0, 0, 0, 0.03, 0]), finger_width_m=0.021)
    assert verdict(moved, STATE).wrong == ("a joint moved by 0.030 rad", "the fingers moved by 1.00 mm")


def test_a_released_dlo_and_a_lost_latch_are_named() -> None:
    lost = msgspec.structs.replace(STATE, holding=False, stop_latched=False)
    assert verdict(lost, STATE).wrong == ("the stop was not latched all the time", "the fingers let the DLO go")


def test_an_accepted_or_missing_attempt_is_named() -> None:
    accepted = (replace(REFUSALS[0], ended_as="Succeeded"), REFUSALS[1])
    assert verdict(attempts=accepted).wrong == (
        "robot.move_joints was not refused: Succeeded",
        "robot.recover was not tried",
    )


def test_an_attempt_that_reached_no_arm_proves_nothing() -> None:
    unsent = replace(REFUSALS[0], ended_as="Unreachable")
    assert verdict(attempts=(unsent, *REFUSALS)).wrong == ()
    assert verdict(attempts=(unsent, *REFUSALS[1:])).wrong == ("robot.move_joints was not tried",)


def test_the_command_must_confirm_by_its_lines_and_by_its_exit_code() -> None:
    assert verdict(report=StopReport(confirmed_s=None, exit_code=3, said="no feedback"), goes_on=False).wrong == (
        "the stop was not confirmed: no feedback",
        "exit code 3 of dlokit stop, which should be 0",
        "the arm did not move again after dlokit enable",
    )


def press(confirmed_s: float | None, *wrong: str) -> Press:
    return Press(confirmed_s=confirmed_s, moved_rad=0.001, fingers_m=0.0, wrong=wrong)


def test_the_bound_requires_a_confirmation_within_a_second_and_no_violation() -> None:
    def holds(*presses: Press) -> bool:
        return stops_hold({"a row": presses})

    assert stops_hold({})
    assert holds(press(0.2), press(0.9))
    assert not holds(press(0.2), press(1.1))
    assert not holds(press(0.2), press(None))
    assert not holds(press(0.2, "a joint moved by 0.030 rad"))


def test_a_stop_that_was_never_confirmed_is_counted_and_has_no_time() -> None:
    presses = (press(0.1), press(None, "the stop was not confirmed"), press(0.3))
    rows = {row.metric: (row.value, row.unit) for row in press_figures({"fingers close": presses})}
    assert rows == {
        "never confirmed": (1, "1"),
        "confirmed after, p50": (0.3, "s"),
        "joints moved after, max": (0.001, "rad"),
        "fingers moved after, max": (0.0, "m"),
        "wrong": (1, "1"),
    }
