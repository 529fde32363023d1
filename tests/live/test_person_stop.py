"""Cell, robot and commander as live processes: a person's stop holds, whatever happens to the commander."""

import asyncio

from dlokit.app.bench.stop import PERSON
from dlokit.benches.stop.presses import ROWS, STARTING, PressPlan, measure_presses
from dlokit.system.config import RunConfig


def test_nothing_moves_between_a_persons_stop_and_the_enabling_of_the_arm() -> None:
    plan = PressPlan(run=RunConfig(runtime="live", headless=True), presses=1, busy_processes=0, seed=0)
    # `dlokit bench stop` measures the time; on a busy machine, a test only checks that it stops.
    rows = asyncio.run(measure_presses(plan, PERSON, print))
    assert [row.name for row in rows] == [STARTING.name, *(row.name for row in ROWS)]
    for row in rows:
        for press in row.presses:
            assert press.wrong == (), row.name
