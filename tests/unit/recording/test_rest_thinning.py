import msgspec
import numpy as np
import pytest
from example_messages import EXAMPLES

from dlokit.communication import topics
from dlokit.recording.recorder import REST_BEGINS_S, REST_STATES_PER_S, RestThinning
from dlokit.types.robot import RobotMode, RobotState

STEP_NS = 20_000_000


def state(**changes: object) -> RobotState:
    example = EXAMPLES[topics.ROBOT_STATE.name]
    assert isinstance(example, RobotState)
    at_rest = {"dq_rad_s": np.zeros(7), "mode": RobotMode.IDLE}
    return msgspec.structs.replace(example, **(at_rest | changes))


def kept(states: list[RobotState]) -> list[int]:
    """Numbers of the states that are recorded, of a sequence at 50 Hz."""
    thinning = RestThinning()
    return [number for number, one in enumerate(states) if thinning.keeps("robot/state", number * STEP_NS, one)]


def test_an_arm_at_rest_is_recorded_at_a_low_rate_once_it_has_settled() -> None:
    numbers = kept([state()] * 500)  # 10 s
    settled = int(1e9 * REST_BEGINS_S / STEP_NS)
    assert numbers[:settled] == list(range(settled))
    assert set(np.diff(numbers[settled:])) == {1e9 / REST_STATES_PER_S / STEP_NS}


def test_every_state_of_a_moving_arm_is_recorded_even_if_it_creeps() -> None:
    q = state().q_rad
    assert len(kept([state(q_rad=q + 2e-5 * number, dq_rad_s=np.full(7, 1e-3)) for number in range(500)])) > 450
    assert len(kept([state(dq_rad_s=np.full(7, 0.01))] * 500)) == 500


@pytest.mark.parametrize(
    "change",
    [
        {"q_rad": state().q_rad + 2e-4},
        {"finger_width_m": state().finger_width_m + 1e-3},
        {"mode": RobotMode.FAULT},
        {"holding": not state().holding},
        {"stop_latched": True},
    ],
)
def test_a_change_is_recorded_at_once(change: dict[str, object]) -> None:
    assert 101 in kept([state()] * 101 + [state(**change)])


def test_arms_do_not_disturb_each_other() -> None:
    thinning = RestThinning()
    away = state(q_rad=state().q_rad + 1.0)
    for number in range(200):
        thinning.keeps("robot/state", number * STEP_NS, state())
        thinning.keeps("robot/state/second", number * STEP_NS, away)
    assert not thinning.keeps("robot/state", 200 * STEP_NS + 1, state())
