"""An operator at the page of a live run, with a real browser and no terminal: goal after goal."""

import asyncio
import json
import os
import re
import sys
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
from chromium import NEEDS_CHROMIUM, collect_errors, draw_with_button_held, launched, new_page
from playwright.async_api import Browser, Locator, Page, async_playwright

pytestmark = NEEDS_CHROMIUM

STARTS_S = 180.0
TASK_S = 300.0  # a task takes 20 to 40 s of an idle machine; the browser's software rendering takes much of this one
DRAWN_M = ((0.38, -0.2), (0.5, -0.05), (0.5, 0.05), (0.42, 0.2))
"""A bow across the table, x and y [m]."""


@asynccontextmanager
async def _live_run(folder: Path) -> AsyncGenerator[str]:
    """A run that waits for goals, and the address of its page."""
    command = ["-m", "dlokit", "shape", "--runtime", "live", "--goal", "interactive", "--port", "0", "--seed", "3"]
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *command,
        "--out",
        str(folder),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env={**os.environ, "COLUMNS": "200"},
    )
    assert process.stdout is not None
    try:
        async with asyncio.timeout(STARTS_S):
            while (line := (await process.stdout.readline()).decode()) and "viewer: " not in line:
                pass
        found = re.search(r"http://\S+", line)
        assert found is not None
        reading = asyncio.create_task(process.stdout.read())  # a full pipe would hold the run
        yield found[0]
        assert await asyncio.wait_for(process.wait(), STARTS_S) == 0, (await reading).decode()
    finally:
        if process.returncode is None:
            process.terminate()
            await process.wait()


class Operator:
    """Uses the page with mouse and eyes."""

    def __init__(self, browser: Browser, url: str, errors: list[str]) -> None:
        self._browser, self._url, self._errors = browser, url, errors

    async def opens(self) -> Page:
        page = await new_page(self._browser, 820, 720)
        collect_errors(page, self._errors)
        await page.goto(self._url)
        await _button(page, "STOP").wait_for()
        return page

    async def waits_for_end(self, page: Page, number: int, goal: str) -> None:
        end = page.locator(f'[data-end="{number}"]')
        await end.wait_for(timeout=TASK_S * 1000)
        assert f"Task {number}, to {goal}: converged" in await end.inner_text()


def _button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=name, exact=True)


async def _starts(page: Page) -> None:
    """Press “Shape it” as soon as it is on, and wait until the task runs."""
    await _button(page, "Shape it").click()
    await page.get_by_text("Watch, and press STOP if anything goes wrong.").wait_for()


async def _chooses(page: Page, name: str) -> None:
    await page.get_by_role("tab", name="Goal").click()
    await page.get_by_label("Shape", exact=True).click()
    await page.get_by_role("option", name=name, exact=True).click()


async def _draws(page: Page, corners: Sequence[tuple[float, float]]) -> None:
    """Draw a line through points x, y of the table [m]."""
    await page.get_by_role("tab", name="Goal").click()
    await _button(page, "Draw on the table").click()
    await page.get_by_text("Drawing a goal").first.wait_for()
    await draw_with_button_held(page, corners)
    await page.mouse.up()


async def _killed_shows(page: Page, run: Path) -> None:
    """Kill the observer, and wait until the page says so and until it answers again."""
    pids = {row["name"]: row["pid"] for row in json.loads((run / "processes.json").read_text())["processes"]}
    psutil.Process(pids["observer"]).kill()
    await page.get_by_text("Not answering: observer").first.wait_for()
    await page.get_by_text("Not answering: observer").first.wait_for(state="detached")


def test_three_shapes_one_after_the_other_without_a_terminal(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    errors: list[str] = []

    async def main() -> None:
        async with _live_run(folder) as url, async_playwright() as playwright:
            browser = await launched(playwright)
            operator = Operator(browser, url, errors)
            page = await operator.opens()
            await _chooses(page, "U")
            await _starts(page)
            await operator.waits_for_end(page, 1, "U")
            await _killed_shows(page, folder)
            await page.get_by_role("tab", name="Goal").click()
            await _button(page, "Take what the camera sees").click()
            await _chooses(page, "S")
            await _starts(page)
            await browser.close()  # for good, in mid-run
            browser = await launched(playwright)
            operator = Operator(browser, url, errors)
            page = await operator.opens()
            # The second visitor has a browser of its own: pages of one browser share the process that draws them, in
            # which the second took 37 s to open beside an idle run, and 12 s in its own.
            other = await launched(playwright)
            second = await Operator(other, url, errors).opens()
            await operator.waits_for_end(page, 2, "S")
            await operator.waits_for_end(second, 2, "S")
            await other.close()
            await _draws(page, DRAWN_M)
            await _starts(page)
            await operator.waits_for_end(page, 3, "drawn")
            await page.get_by_role("tab", name="Task").click()
            await _button(page, "End run").click()
            await browser.close()

    asyncio.run(main())
    assert errors == []
    for number in (1, 2, 3):
        result = json.loads((folder / f"task-{number}" / "result.json").read_text())
        assert result["outcome"] == "converged"
        assert (folder / f"task-{number}" / "report.html").exists()
