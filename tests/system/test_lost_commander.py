"""Cell, robot and a commander as real processes: whichever way the commander is lost, the arm brakes."""

import asyncio

import pytest

from dlokit.bench.faults.stopping import StopPlan, measure_stops
from dlokit.system.config import RunConfig

pytestmark = pytest.mark.system


def test_an_arm_whose_commander_is_killed_or_frozen_brakes_and_the_next_one_moves_it_again() -> None:
    plan = StopPlan(
        run=RunConfig(runtime="live", headless=True), kills=1, freezes=1, quiet_s=0.0, busy_processes=0, seed=0
    )
    # How soon is measured by `dlokit bench stop`; a test on a machine that does other things as well asks whether.
    figures = asyncio.run(measure_stops(plan, lambda said: None))
    for stop in (*figures.killed, *figures.frozen):
        assert stop.began_s is not None
        assert stop.stood_s is not None
