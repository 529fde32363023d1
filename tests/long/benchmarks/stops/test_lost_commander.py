"""Cell, robot and commander as live processes: the arm brakes when it loses its commander or its feedback."""

import asyncio
import itertools

from dlokit.system.config import RunConfig
from parts.stops.stopping import StopPlan, measure_stops


def test_an_arm_whose_commander_or_feedback_is_lost_brakes_and_moves_again_when_it_is_back() -> None:
    plan = StopPlan(
        run=RunConfig(runtime="live", headless=True),
        kills=1,
        freezes=1,
        feedback_losses=1,
        quiet_s=0.0,
        busy_processes=0,
        seed=0,
    )
    # The study of stops measures the time; on a busy machine, a test only checks that it brakes.
    figures = asyncio.run(measure_stops(plan, lambda said: None))
    assert len(figures.by_fault) == 4
    for stop in itertools.chain(*figures.by_fault.values()):
        assert stop.began_s is not None
        assert stop.stood_s is not None
