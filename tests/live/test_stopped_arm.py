"""A live arm and cell whose commander fails: a person's stop holds, and the arm brakes; its viewer is restarted."""

import asyncio
import os
import signal
import time
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from live_systems import HANGS_S, Background, background

from dlokit.app.operate import stop
from dlokit.communication import topics
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.config import RunConfig
from dlokit.system.live_system import LiveSystem
from dlokit.system.processes.running import RunningSystem
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import VIEWER
from parts.arm_and_cell import arm_and_cell
from parts.faults.disturbance import FILE_NAME as DISTURBANCE
from parts.faults.disturbance import disturbed_process
from parts.stops.braking import FROZEN, KILLED, WITHHELD, ArmStop, FaultTrials
from parts.stops.commander import Commanded
from parts.stops.press_verdict import StopReport
from parts.stops.presses import ROWS, PressMoment, PressTrials, press_at_start

RUN = RunConfig(runtime="live", viewer=ViewerConfig(port=0))
FOUND_WITHIN_S = 10.0
"""A commander that is there is found in milliseconds; where there is none, a stop waits for as long [s]."""


async def _stop(system: RunningSystem, say: Callable[[str], None]) -> int:
    """`dlokit stop`, as patient as a slow machine needs."""
    return stop.exit_code(await stop.stop_all([system], FOUND_WITHIN_S, HANGS_S, HANGS_S, say))


@dataclass(frozen=True, kw_only=True)
class Arm:
    """The system that these tests share."""

    live: LiveSystem
    folder: Path
    presses: PressTrials
    at_start: StopReport
    """The stop that was pressed during the start."""


@asynccontextmanager
async def stopped_at_start(folder: Path) -> AsyncGenerator[Arm]:
    """Start the system and stop it meanwhile."""
    run_dir = folder / "run"
    run_dir.mkdir()
    rng = np.random.default_rng(0)
    stopping = asyncio.create_task(press_at_start(run_dir, _stop, rng))
    async with arm_and_cell(run_dir, RUN, VIEWER, command=disturbed_process(folder / DISTURBANCE)) as live:
        presses = PressTrials(Commanded(live), run_dir, rng, _stop)
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
    press = loop.run(arm.presses.after_start(arm.at_start))
    assert press.wrong == ()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_nothing_moves_between_a_persons_stop_and_the_enabling_of_the_arm(
    loop: Background, arm: Arm, row: PressMoment
) -> None:
    (press,) = loop.run(arm.presses.row(row, 1, print))
    assert press.wrong == ()


def test_an_arm_whose_commander_or_feedback_is_lost_brakes_and_moves_again_when_it_is_back(
    loop: Background, arm: Arm
) -> None:
    async def faults() -> list[ArmStop]:
        trials = FaultTrials(Commanded(arm.live), arm.folder, 0, print, HANGS_S / 4)
        try:
            await trials.begin()
            stops = [*await trials.after(FROZEN, 1), *await trials.after(KILLED, 1), *await trials.after(WITHHELD, 1)]
            await trials.moving(after_s=time.monotonic())
        finally:
            trials.commanded.kill()
        return stops

    # The study of stops measures how soon, and the same with a second arm that falls silent.
    for each in loop.run(faults()):
        assert each.began_s is not None
        assert each.stood_s is not None


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
