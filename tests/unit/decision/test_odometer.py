import asyncio
from collections.abc import AsyncIterator

import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.decision.task import Odometer
from dlokit.geometry import downward
from dlokit.types.robot import RobotMode, RobotState


def _state(robot: str, x_m: float, y_m: float) -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        robot=robot,
        T_world_tcp=downward([x_m, y_m, 0.4], 0.0),
        mode=RobotMode.MOVING,
    )


async def _states(*states: RobotState) -> AsyncIterator[RobotState]:
    for state in states:
        yield state


def test_the_distance_there_and_back_counts_twice() -> None:
    odometer = Odometer()

    asyncio.run(odometer.follow(_states(_state("a", 0.3, 0.0), _state("a", 0.6, 0.4), _state("a", 0.3, 0.0))))

    assert odometer.travelled_m == pytest.approx(1.0)


def test_two_arms_at_rest_have_travelled_no_distance() -> None:
    odometer = Odometer()

    asyncio.run(odometer.follow(_states(_state("a", 0.3, 0.0), _state("b", 0.9, 0.0), _state("a", 0.3, 0.0))))

    assert odometer.travelled_m == 0.0
