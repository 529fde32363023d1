"""Set-points of an arm of the cell that mirrors another: by the stamps of its states, whenever they arrive."""

import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.description.arm.franka import PANDA
from dlokit.functional.cell.config import TICK_S, CellConfig
from dlokit.functional.cell.setpoints import Mirror
from dlokit.functional.cell.world import Cell
from dlokit.types.robot import RobotMode, RobotState

START_NS = 5_000_000_000
HOME = PANDA.home_q_rad
SPEED_RAD_S = 0.5


def state(time_s: float, q_rad: np.ndarray, reported_rad_s: float = SPEED_RAD_S) -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        stamp_ns=START_NS + round(time_s * 1e9),
        q_rad=q_rad,
        dq_rad_s=np.full(7, reported_rad_s),
        finger_width_m=0.08,
        mode=RobotMode.MOVING,
    )


def moved(time_s: float) -> np.ndarray:
    return HOME + SPEED_RAD_S * time_s


def moving(until_s: float, reported_rad_s: float = SPEED_RAD_S) -> Mirror:
    mirror = Mirror(HOME, START_NS)
    for number in range(round(until_s / 0.008) + 1):
        mirror.receive(state(number * 0.008, moved(number * 0.008), reported_rad_s))
    return mirror


def test_before_the_first_state_it_stays_at_home() -> None:
    np.testing.assert_array_equal(Mirror(HOME, START_NS).at(1.0).q_rad, HOME)


@pytest.mark.parametrize("time_s", [0.1, 0.203, 0.4, 0.41, 0.43])
def test_it_is_where_the_other_arm_was_or_goes_by_the_stamps(time_s: float) -> None:
    point = moving(until_s=0.4).at(time_s)
    np.testing.assert_allclose(point.q_rad, moved(time_s), atol=1e-6)  # stamps are whole nanoseconds
    np.testing.assert_allclose(point.dq_rad_s, SPEED_RAD_S, atol=1e-5)


def test_an_arm_whose_clock_is_slow_is_mirrored_by_its_positions_and_not_by_its_own_velocities() -> None:
    point = moving(until_s=0.4, reported_rad_s=2 * SPEED_RAD_S).at(0.42)
    np.testing.assert_allclose(point.q_rad, moved(0.42), atol=1e-6)


def test_without_newer_states_it_comes_to_stand_after_50_ms() -> None:
    mirror = moving(until_s=0.4)
    np.testing.assert_allclose(mirror.at(3.0).q_rad, moved(0.45), atol=1e-6)
    np.testing.assert_array_equal(mirror.at(3.0).dq_rad_s, 0.0)


def test_an_older_state_changes_nothing() -> None:
    mirror = moving(until_s=0.4)
    mirror.receive(state(0.1, HOME + 1.0))
    np.testing.assert_allclose(mirror.at(0.4).q_rad, moved(0.4), atol=1e-6)


def test_a_cell_that_falls_behind_and_skips_time_finds_its_mirrored_arm_at_its_new_stamp() -> None:
    cell = Cell(CellConfig(settle_s=0.0), seed=0)
    mirror = cell.mirror()
    cell.begin_at(START_NS)
    cell.skip(200_000_000)
    for number in range(100):
        mirror.receive(state(number * 0.008, moved(number * 0.008)))
    cell.step(0.4)
    assert cell.time_ns == START_NS + 600_000_000
    # Its servos lag by some milliradians; without the skip it would be 100 behind.
    np.testing.assert_allclose(cell.arm_state().q_rad, moved(0.6), atol=5e-3)
    cell.close()


def test_the_arm_begins_where_the_other_arm_stands() -> None:
    cell = Cell(CellConfig(settle_s=0.0), seed=0)
    stands = HOME + 0.3
    mirror = cell.mirror()
    for number in range(3):
        mirror.receive(state(number * 0.008 - 5.0, stands, 0.0))
    cell.step(TICK_S)
    np.testing.assert_allclose(cell.arm_state().q_rad, stands, atol=2e-3)
    cell.close()
