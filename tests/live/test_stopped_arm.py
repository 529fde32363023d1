"""A live arm and cell whose commander fails: a person's stop holds, and the arm brakes; its viewer is restarted."""

import asyncio
import os
import signal
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from live_arm import arm_and_cell
from live_systems import HANGS_S, Background, background

from dlokit.app.operate import stop
from dlokit.communication import topics
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.config import RunConfig
from dlokit.system.live import LiveSystem
from dlokit.system.processes.running import RunningSystem
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import VIEWER
from parts.faults.disturbance import FILE_NAME as DISTURBANCE
from parts.faults.disturbance import disturbed_process
from parts.stops.press_verdict import StopReport
from parts.stops.presses import ROWS, STARTING, Person, PressMoment, PressScene, Trials, stop_at_start
from parts.stops.stopping import FaultTrials, StopFigures, StopPlan
from stops import PERSON

RUN = RunConfig(runtime="live", viewer=ViewerConfig(port=0))
FOUND_WITHIN_S = 10.0
"""A commander that is there is found in milliseconds; where there is none, a stop waits for as long [s]."""
PLAN = StopPlan(
    run=RUN,
    kills=1,
    freezes=1,
    feedback_losses=1,
    quiet_s=0.0,
    busy_processes=0,
    seed=0,
    brakes_within_s=HANGS_S / 4,
)


async def _stop(system: RunningSystem, say: Callable[[str], None]) -> int:
    """`dlokit stop`, as patient as a slow machine needs."""
    return stop.exit_code(await stop.stop_all([system], FOUND_WITHIN_S, HANGS_S, HANGS_S, say))


@dataclass(frozen=True, kw_only=True)
class Arm:
    """The system that these tests share."""

    live: LiveSystem
    folder: Path
    presses: Trials
    at_start: tuple[StopReport, float]
    """The stop that was pressed during the start."""


@asynccontextmanager
async def stopped_at_start(folder: Path) -> AsyncGenerator[Arm]:
    """Start the system and stop it meanwhile."""
    run_dir = folder / "run"
    run_dir.mkdir()
    scene = PressScene(RUN, Person(stop=_stop, enable=PERSON.enable), print, np.random.default_rng(0))
    disturbed = disturbed_process(folder / DISTURBANCE)
    stopping = asyncio.create_task(stop_at_start(scene, run_dir))
    async with arm_and_cell(run_dir, RUN, VIEWER, command=disturbed) as live:
        presses = Trials(scene, live, run_dir)
        yield Arm(live=live, folder=folder, presses=presses, at_start=await stopping)


@pytest.fixture(scope="module")
def loop() -> Generator[Background]:
    with background() as loop:
        yield loop


@pytest.fixture(scope="module")
def arm(loop: Background, tmp_path_factory: pytest.TempPathFactory) -> Generator[Arm]:
    with loop.entered(stopped_at_start(tmp_path_factory.mktemp("arm"))) as arm:
        yield arm


def test_an_arm_that_is_stopped_while_its_system_starts_never_moves_until_it_is_enabled(
    loop: Background, arm: Arm
) -> None:
    press = loop.run(arm.presses.after_start(*arm.at_start, STARTING))
    assert press.wrong == ()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_nothing_moves_between_a_persons_stop_and_the_enabling_of_the_arm(
    loop: Background, arm: Arm, row: PressMoment
) -> None:
    (press,) = loop.run(arm.presses.row(row, 1)).presses
    assert press.wrong == ()


def test_an_arm_whose_commander_or_feedback_is_lost_brakes_and_moves_again_when_it_is_back(
    loop: Background, arm: Arm
) -> None:
    async def faults() -> StopFigures:
        trials = FaultTrials(PLAN, arm.live, arm.folder, print)
        try:
            await trials.begin()
            figures = await trials.of_commander()
            figures = replace(figures, withheld=await trials.feedback_withheld())
            await trials.begin()
        finally:
            trials.end()
        return figures

    # The study of stops measures how soon, and the same with a second arm that falls silent.
    by_fault = loop.run(faults()).by_fault
    assert set(by_fault) == {"commander killed", "commander frozen", "feedback withheld"}
    for (fault,) in by_fault.values():
        assert fault.began_s is not None
        assert fault.stood_s is not None


def test_open_pages_reconnect_to_a_restarted_viewer_because_its_address_is_the_same(loop: Background, arm: Arm) -> None:
    async def addresses() -> list[str]:
        pages = aiter(arm.live.transport.stream(topics.VIEWER_PAGE, with_last=True))
        first = await anext(pages)
        os.kill(arm.live.supervisor.pids["viewer"], signal.SIGKILL)
        return [page.url for page in (first, await anext(pages))]

    first, again = loop.run(addresses())
    assert first == again
    one, other = (Launch(namespace="run", config_file=arm.folder, run_dir=arm.folder) for _ in range(2))
    assert one.page_key != other.page_key  # another run has another address
