"""How often an arm is braked though nothing is wrong: ropes are shaped live on a busy machine beside a browser.

    python benchmarks/no_false_brakes.py --minutes 10 --busy 2 --pages 20

Runs `dlokit shape` from I to S and from S to I, live and with the viewer, until the time is over. Prints a line a run:
its robot calls, and those that ended because a lease, the arm's feedback or a neighbour's came late. Meanwhile the page
is opened in a headless Chromium, looked at and closed again, so many times in all; that needs what the browser tests
need (`make test` installs it). Exit code 3 where any motion was braked so.
"""

import asyncio
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from playwright.async_api import Browser, async_playwright
from rich.console import Console

from dlokit.communication import topics
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import without_interval
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import read_recording
from dlokit.system.results.run_result import read_result
from dlokit.types.outcome import CallRecord
from dlokit.types.robot import Remedy, RobotReason
from parts.arm_and_cell import burden
from parts.command import check_json, run_study, write_figures
from parts.live_run import LiveRun, StartedCommand, live_run

BRAKED = frozenset(reason.value for reason in RobotReason if reason.remedy is Remedy.RECOVER)
ENDS_WITHIN_S = 300.0
CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = ["--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"]
LOOKED_AT_S = 5.0
BETWEEN_S = 5.0
EXIT_BRAKED = 3


@dataclass(frozen=True, kw_only=True)
class Args:
    """Shape ropes on a busy machine and count the motions that were braked for nothing."""

    minutes: float = 10.0
    """The run that goes on after this time is the last [min]."""
    busy: int = 2
    """Processes that keep the machine busy meanwhile."""
    pages: int = 20
    """Times that the page is opened and closed, over all runs; 0 runs without a browser."""
    arms: int = 1
    """1 or 2."""
    json: Path | None = None
    """Also write every count to this file."""


class Visitor:
    """Opens the page of a run, looks at it, closes it, and comes again."""

    def __init__(self, browser: Browser, most: int) -> None:
        self._browser = browser
        self._most = most
        self.visits = 0

    async def come_and_go(self, run: LiveRun) -> None:
        """Until it has come often enough, or is cancelled."""
        page_of_run = None
        while page_of_run is None:
            await asyncio.sleep(0.5)
            page_of_run = run.bus.transport.latest(topics.VIEWER_PAGE).value
        while self.visits < self._most:
            page = await self._browser.new_page()
            await page.goto(page_of_run.url)
            await page.locator("canvas").first.wait_for()
            await asyncio.sleep(LOOKED_AT_S)
            await page.close()
            self.visits += 1
            await asyncio.sleep(BETWEEN_S)


async def shaped(args: Args, folder: Path, number: int, visitor: Visitor) -> Counter[str]:
    """One run; how often its robot calls ended by which reason, the empty one when they were carried out."""
    start, goal = ("S", "I") if number % 2 else ("I", "S")
    task = ("--start", start, "--goal", goal, "--seed", str(number), "--arms", str(args.arms))
    run_dir = folder / str(number)
    program = StartedCommand(
        arguments=("shape", "--runtime", "live", "--viewer.port", "0", *task, "--out", str(run_dir)),
        output=folder / f"{number}.txt",
    )
    async with live_run(program, run_dir) as run:
        visiting = asyncio.create_task(visitor.come_and_go(run))
        await program.ends_within(ENDS_WITHIN_S)
        visiting.cancel()
        await asyncio.gather(visiting, return_exceptions=True)
    ends = Counter(
        call.reason
        for call in (one.message for one in read_recording(run_dir / FILE_NAME))
        if isinstance(call, CallRecord) and call.skill.startswith("robot")
    )
    result, braked = read_result(run_dir), {reason: ends[reason] for reason in sorted(BRAKED & set(ends))}
    print(
        f"{number:3d}  {start} to {goal}  {result.outcome.value} {result.reason or ''}, {result.actions} actions, "
        f"{sum(ends.values())} robot calls, braked for nothing: {braked or 'none'}; {visitor.visits} visits so far",
        flush=True,
    )
    return ends


def run(args: Args) -> int:
    """Shape ropes and print; exit code 3 where a motion was braked for nothing."""
    check_json(args.json)
    with tempfile.TemporaryDirectory(prefix="dlokit-brakes-") as folder:
        return asyncio.run(count_brakes(args, Path(folder)))


async def count_brakes(args: Args, folder: Path) -> int:
    """Shape until the time is over; exit code."""
    end_s, ends = time.monotonic() + 60.0 * args.minutes, Counter[str]()
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        visitor, number = Visitor(browser, args.pages), 0
        with burden(args.busy):
            while time.monotonic() < end_s:
                ends += await shaped(args, folder, number, visitor)
                number += 1
        await browser.close()
    braked = sum(ends[reason] for reason in BRAKED)
    print(f"{number} runs, {sum(ends.values())} robot calls, {visitor.visits} visits: {braked} braked for nothing")
    counts = {"runs": number, "robot calls": sum(ends.values()), "visits": visitor.visits, "braked": braked}
    rows = [figure("all runs", "dlokit", name, without_interval(float(n), number), "1") for name, n in counts.items()]
    settings = {"minutes": args.minutes, "busy": args.busy, "pages": args.pages, "arms": args.arms}
    write_figures(args.json, "no_false_brakes", rows, settings, Console())
    return EXIT_BRAKED if braked else 0


if __name__ == "__main__":
    run_study(Args, run, __doc__)
