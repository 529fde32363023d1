"""A recorded run on the viewer's page, played and sought."""

import asyncio
import re
from dataclasses import replace
from pathlib import Path

import pytest
from made_fixtures import FURNISHED

from dlokit.description.installation import Installation
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.writer import RecordingWriter
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.skills.viewer.playback import MarkKind
from dlokit.skills.viewer.state import Newest, RunState
from dlokit.system.build import build_viewer
from dlokit.system.config import RunConfig
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.watching import WATCHED_PARTS, RecordedRun, show

REFERENCE = Path(__file__).parents[2] / "replay" / "references" / "wire.mcap"
LIMIT_S = 60.0  # it takes one


@pytest.fixture(scope="module")
def run() -> RecordedRun:
    return RecordedRun(REFERENCE)


@pytest.fixture
def viewer(run: RecordedRun) -> ViewerComponent:
    """The page of the run, which no browser has opened yet."""
    run.player.pause()
    run.player.seek(0.0)
    return build_viewer(recorded_config(REFERENCE, WATCHED_PARTS), operated=False, player=run.player)


def test_the_page_of_a_recorded_run_has_its_fixtures(tmp_path: Path) -> None:
    config = replace(RunConfig(), installation=Installation(fixtures=FURNISHED.fixtures))
    RecordingWriter(tmp_path / FILE_NAME, {"configuration": {"config.toml": to_toml(config)}}).close()
    known = recorded_config(tmp_path / FILE_NAME, WATCHED_PARTS)
    drawn = vars(build_viewer(known, operated=False))["_around"]
    assert drawn.fixtures == FURNISHED.fixtures


def _look(viewer: ViewerComponent) -> dict[str, object]:
    """What the page shows, as the stamps of the messages and what was made of them."""
    seen = viewer.seen
    newest = {name: value.value for name, value in vars(seen).items() if isinstance(value, Newest)}
    return {
        **{name: getattr(value, "stamp_ns", None) for name, value in newest.items()},
        "arms": [arm.value.stamp_ns for arm in seen.robots.values() if arm.value is not None],
        "step": seen.active_step.step,
        "errors": seen.history.arrays()[1].tolist(),
    }


def test_the_run_plays_when_the_page_is_first_opened_until_its_end(run: RecordedRun, viewer: ViewerComponent) -> None:
    async def main() -> None:
        await run.show_next(viewer, 1.0)
        assert run.player.position_s == 0.0
        viewer.visited.set()
        for _ in range(int(run.player.timeline.duration_s) + 1):
            await run.show_next(viewer, 1.0)
        assert run.player.ended
        assert not run.player.playing
        assert viewer.seen.run_state is RunState.ENDED
        assert viewer.seen.history.arrays()[0].max() >= 1.0

    asyncio.run(main())


def test_a_moment_looks_the_same_whether_it_is_played_to_or_sought_from_later(
    run: RecordedRun, viewer: ViewerComponent
) -> None:
    async def main() -> None:
        moments_s = [part * run.player.timeline.duration_s for part in (0.2, 0.5, 0.8)]
        played: list[dict[str, object]] = []
        run.player.skips_waits, run.player.playing = False, True
        for moment_s in moments_s:
            for _ in range(10):
                await run.show_next(viewer, (moment_s - run.player.position_s) / 2.0)
            await run.show_next(viewer, moment_s - run.player.position_s)
            played.append(_look(viewer))
        run.player.pause()
        sought: list[dict[str, object]] = []
        for moment_s in reversed(moments_s):
            run.player.seek(moment_s)
            await run.show_next(viewer, 1.0)
            sought.append(_look(viewer))
        assert sought[::-1] == played
        assert len({str(each) for each in played}) == len(moments_s)

    asyncio.run(main())


def test_the_time_of_a_recorded_run_is_said_to_be_that_of_its_end(run: RecordedRun) -> None:
    assert re.fullmatch(r"ended \d{4}-\d\d-\d\d \d\d:\d\d", run.player.timeline.recorded_at)


def test_the_timeline_has_every_step_the_actions_that_were_made_and_the_end(run: RecordedRun) -> None:
    line = run.player.timeline
    names = [mark.name for mark in line.of(MarkKind.STEP)]
    assert {"choose grasp", "grasp", "release"} <= set(names)
    first, *_ = line.of(MarkKind.ACTION)
    (end,) = line.of(MarkKind.END)
    assert first.name == "task 1, action 1"
    assert end.name.startswith("task 1: ")
    assert [mark.time_s for mark in line.marks] == sorted(mark.time_s for mark in line.marks)
    assert 0.0 < first.time_s < end.time_s <= line.duration_s


@pytest.mark.live
def test_the_page_is_served_until_it_is_cancelled() -> None:
    config = recorded_config(REFERENCE, WATCHED_PARTS)
    config = replace(config, viewer=replace(config.viewer, port=0))

    async def main() -> list[str]:
        said: list[str] = []
        served = asyncio.Event()

        def say(text: str) -> None:
            said.append(text)
            served.set()

        showing = asyncio.create_task(show(REFERENCE, config, 1.0, say))
        waiting = asyncio.create_task(served.wait())
        done, _ = await asyncio.wait({showing, waiting}, timeout=LIMIT_S, return_when=asyncio.FIRST_COMPLETED)
        if showing in done:
            await showing  # raises why it is not served
        assert done == {waiting}
        showing.cancel()
        await asyncio.wait({showing})
        return said

    (url,) = asyncio.run(main())
    assert url.startswith("viewer: http://127.0.0.1:")
