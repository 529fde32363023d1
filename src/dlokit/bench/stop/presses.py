"""Whether a person's stop holds: pressed at random moments, whatever the commander does or has become of it."""

import asyncio
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.bench.stop import programs
from dlokit.bench.stop.press_trials import NOT_ALL, Person, PressMoment, PressScene, Trials, until_there
from dlokit.bench.stop.press_verdict import Press, PressRow, StopReport
from dlokit.bench.stop.small_system import arm_and_cell, burden
from dlokit.communication.container import end_tasks
from dlokit.errors import InputError, ProcessFailure
from dlokit.system.config import RunConfig
from dlokit.system.processes.running import RunningSystem, the_running_system

STARTING_S = 1.5
"""A stop comes within this time of the start of a system [s]: its robot's process is not ready yet."""


# fmt: off
STARTING = PressMoment(name="system starts")
ROWS = (
    PressMoment(name="commander frozen", moment=Trials.frozen, then=Trials.thaw, exit_code=NOT_ALL),
    PressMoment(name="commander killed", moment=Trials.killed, then=Trials.replace, exit_code=NOT_ALL),
    PressMoment(name="recover runs", moment=Trials.recovers),
    PressMoment(name="between motions", program=programs.WITH_PAUSES, moment=Trials.pauses),
    PressMoment(name="fingers close", program=programs.GRIPS, moment=Trials.closes),
    PressMoment(name="DLO is carried", program=programs.CARRIES, moment=Trials.carries, holds=True),
)
# fmt: on


@dataclass(frozen=True, kw_only=True)
class PressPlan:
    """What to measure."""

    run: RunConfig
    presses: int
    """Stops of each row."""
    busy_processes: int
    seed: int


async def measure_presses(plan: PressPlan, person: Person, said: Callable[[str], None]) -> tuple[PressRow, ...]:
    """Press and enable as often as planned in each row; `said` hears how far it is.

    Raises `ProcessFailure` when a system does not start, or is ready too soon.
    """
    scene = PressScene(plan.run, person, said, np.random.default_rng(plan.seed))
    rows = [await _row_of_starts(scene, plan.presses)]
    with tempfile.TemporaryDirectory(prefix="dlokit-press-") as folder:
        async with arm_and_cell(plan.run, Path(folder)) as live:
            with burden(plan.busy_processes):
                rows += [await Trials(scene, live, Path(folder)).row(row, plan.presses) for row in ROWS]
    return tuple(rows)


async def _row_of_starts(scene: PressScene, count: int) -> PressRow:
    """A new system for each stop."""
    presses: list[Press] = []
    for number in range(count):
        press = await _press_at_start(scene)
        scene.tell(STARTING.name, number, count, press)
        presses.append(press)
    return PressRow(name=STARTING.name, presses=tuple(presses))


async def _press_at_start(scene: PressScene) -> Press:
    with tempfile.TemporaryDirectory(prefix="dlokit-press-") as name:
        folder = Path(name)
        stopping = asyncio.create_task(_stop_at_start(scene, folder), name="stop at the start")
        try:
            async with arm_and_cell(scene.run, folder) as live:
                trials = Trials(scene, live, folder)
                return await trials.after_start(*await stopping, STARTING)
        finally:
            await end_tasks(stopping)


async def _stop_at_start(scene: PressScene, folder: Path) -> tuple[StopReport, float]:
    await until_there(lambda: _announced(folder) is not None)
    await scene.wait_up_to(STARTING_S)
    system = _announced(folder)
    if system is None or not system.starting:
        raise ProcessFailure("not_starting", f"the system was ready, or gone, within {STARTING_S:g} s of its start")
    return await scene.stop(folder)


def _announced(folder: Path) -> RunningSystem | None:
    try:
        return the_running_system(folder, starting=True)
    except InputError:
        return None
