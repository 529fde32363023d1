"""Cell, robot and a commander as real processes: whichever way commander or feedback is lost, the arm brakes."""

import asyncio
import itertools

import pytest

from dlokit.bench.stop.stopping import StopPlan, measure_stops
from dlokit.system.config import RunConfig

pytestmark = pytest.mark.live


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
    # How soon is measured by `dlokit bench stop`; a test on a machine that does other things as well asks whether.
    figures = asyncio.run(measure_stops(plan, lambda said: None))
    assert len(figures.by_fault) == 4
    for stop in itertools.chain(*figures.by_fault.values()):
        assert stop.began_s is not None
        assert stop.stood_s is not None
