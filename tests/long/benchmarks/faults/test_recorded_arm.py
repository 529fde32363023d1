"""When an arm braked, by the states in a recording."""

import msgspec
import numpy as np
from model_bench import robot_at

from dlokit.types.robot import RobotMode, RobotState
from parts.faults.trial import recorded_braking_s

MOVING, BRAKING, IDLE = RobotMode.MOVING, RobotMode.BRAKING, RobotMode.IDLE
STRUCK_NS = 20_000_000


def states(*modes: RobotMode) -> list[RobotState]:
    """A state each 10 ms from 0 on, in these modes."""
    return [
        msgspec.structs.replace(robot_at(np.zeros(3), 10_000_000 * number), mode=mode)
        for number, mode in enumerate(modes)
    ]


def test_an_arm_that_moved_at_the_fault_braked_at_its_first_braking_state() -> None:
    assert recorded_braking_s(states(IDLE, MOVING, MOVING, MOVING, BRAKING, IDLE), STRUCK_NS) == 0.02


def test_a_braking_of_before_the_fault_does_not_count() -> None:
    assert recorded_braking_s(states(MOVING, BRAKING, MOVING, MOVING), STRUCK_NS) is None


def test_a_motion_that_reached_its_end_was_not_braked_by_a_later_one() -> None:
    assert recorded_braking_s(states(MOVING, MOVING, MOVING, IDLE, MOVING, BRAKING), STRUCK_NS) is None


def test_an_arm_that_goes_on_did_not_brake() -> None:
    assert recorded_braking_s(states(MOVING, MOVING, MOVING, MOVING), STRUCK_NS) is None
