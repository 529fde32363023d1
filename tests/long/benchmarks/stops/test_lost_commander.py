"""Cell, robot and commander as live processes: the arm brakes when it loses its commander or its feedback."""

import asyncio
import itertools

from parts.stops.braking import FROZEN, KILLED, SILENT, WITHHELD, measure_braking


def test_an_arm_whose_commander_or_feedback_is_lost_brakes_and_moves_again_when_it_is_back() -> None:
    # The study measures the time; on a busy machine, a test only checks that it brakes.
    times: dict[str, int] = dict.fromkeys((KILLED, FROZEN, WITHHELD, SILENT), 1)
    braking = asyncio.run(measure_braking(times, 0.0, 0, 0, lambda said: None))
    assert braking.by_fault.keys() == times.keys()
    for stop in itertools.chain(*braking.by_fault.values()):
        assert stop.began_s is not None
        assert stop.stood_s is not None
