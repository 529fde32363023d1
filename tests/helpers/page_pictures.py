"""Take the pictures of the viewer's page that the how-to guides show.

    python tests/helpers/page_pictures.py
    python tests/helpers/page_pictures.py --into /tmp/pictures

A headless Chromium uses the page of one live run as an operator does: it chooses a goal, draws one, goes step by step,
stops in mid-carry, pauses, and goes on to the end of a task; then it opens the recording. Writes
docs/images/page-*.jpg. About ten minutes on an idle machine.
"""

import argparse
import asyncio
import json
import tempfile
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
from chromium import draw_with_button_held, drawn, launched, new_page
from playwright.async_api import Browser, Locator, Page, async_playwright
from run_picture import LIMIT_S, PICTURE, image_of, page_of, without_notices

WINDOW_PX = (1280, 720)
TABLET_PX = (768, 1024)
DRAWN_M = ((0.38, -0.2), (0.5, -0.05), (0.5, 0.05), (0.42, 0.2))
"""A bow across the table, x and y [m]."""
CARRIES_S = 3.0
"""From the first motion of a carry until it is stopped [s]: the hand is in the air then."""


class Photographer:
    """Uses a page with mouse and eyes, and keeps what it shows."""

    def __init__(self, page: Page, folder: Path) -> None:
        self._page = page
        self._folder = folder

    def button(self, name: str) -> Locator:
        """A button of the page."""
        return self._page.get_by_role("button", name=name, exact=True)

    async def tab(self, name: str) -> None:
        """Open a tab of the panel."""
        await self._page.get_by_role("tab", name=name).click()

    async def press(self, name: str) -> None:
        """Press a button as soon as it is on."""
        await self.button(name).click()

    async def switch(self, label: str) -> None:
        """Tick or untick a box."""
        await self._page.get_by_role("checkbox", name=label).click()

    async def says(self, text: str) -> None:
        """Wait until the page says something."""
        await self._page.get_by_text(text).first.wait_for()

    async def choose(self, label: str, name: str) -> None:
        """Choose one entry of a list."""
        await self._page.get_by_label(label, exact=True).click()
        await self._page.get_by_role("option", name=name).first.click()

    async def draw(self) -> None:
        """Draw a line on the table, and leave the button of the mouse down."""
        await draw_with_button_held(self._page, DRAWN_M)

    async def leaves_the_drawing(self) -> None:
        """Keep the goal as it was."""
        await self._page.keyboard.press("Escape")
        await self._page.mouse.up()
        await self.says("Waiting for your goal")

    async def take(self, name: str) -> None:
        """Write the picture of this name."""
        await drawn(self._page)
        picture = image_of(await self._page.screenshot())
        path = self._folder / f"page-{name}.jpg"
        picture.save(path, quality=85, optimize=True, progressive=True)
        print(f"{path}: {path.stat().st_size / 1000.0:.0f} kB", flush=True)


@asynccontextmanager
async def _opened(browser: Browser, url: str, size_px: tuple[int, int], folder: Path) -> AsyncGenerator[Photographer]:
    page = await new_page(browser, *size_px)
    page.set_default_timeout(LIMIT_S * 1000)
    await page.goto(url)
    await without_notices(page)
    yield Photographer(page, folder)
    await page.close()


async def _goals(at: Photographer) -> None:
    await at.choose("Shape", "U")
    await at.says("The goal holds")
    await at.take("goal")
    await at.press("Draw on the table")
    await at.says("Drawing a goal")
    await at.draw()
    await at.take("drawing")
    await at.leaves_the_drawing()


async def _task(at: Photographer) -> None:
    """A task that goes step by step, and is stopped while the arm carries the DLO."""
    await at.tab("Task")
    await at.switch("Step by step")
    await at.press("Shape it")
    await at.press("Make this motion")
    await at.says("Next: move down")
    await at.take("step")
    await at.press("Make this motion")
    await at.says("Next: carry the DLO")
    await at.press("Make this motion")
    await asyncio.sleep(CARRIES_S)
    await at.press("STOP")
    await at.says("Task 1, to U: cancelled")
    await at.switch("Step by step")
    await at.tab("Goal")
    await at.take("stopped")


async def _next_task(at: Photographer, run: Path) -> None:
    """The task after a stop, which is paused, to its end; then a process is lost."""
    await at.press("Enable arms")
    await at.press("Shape it")
    await at.press("Pause")
    await at.says("Press Resume to go on")
    await at.button("Shape it").hover(force=True)
    await at.take("paused")
    await at.press("Resume")
    await at.says("Task 2, to U")
    await at.take("ended")
    await at.tab("System")
    pids = {row["name"]: row["pid"] for row in json.loads((run / "processes.json").read_text())["processes"]}
    psutil.Process(pids["simulation"]).kill()
    await at.says("Not answering: model")
    await at.take("lost")


async def _recorded(browser: Browser, run: Path, folder: Path) -> None:
    async with page_of("view", str(run), until="viewer: ") as url, _opened(browser, url, WINDOW_PX, folder) as at:
        await at.press("Pause")
        await at.choose("Go to", "action 1")
        await at.take("recorded")


async def taken(run: Path, folder: Path) -> None:
    """All pictures, in `folder`; the files of the run in `run`, which does not exist yet."""
    command = ("shape", "--runtime", "live", "--goal", "interactive", "--seed", "3", "--out", str(run))
    async with async_playwright() as playwright:
        browser = await launched(playwright)
        async with page_of(*command, until="viewer: ") as url:
            async with _opened(browser, url, WINDOW_PX, folder) as at:
                await _goals(at)
                await _task(at)
                await _next_task(at, run)
            async with _opened(browser, url, TABLET_PX, folder) as at:
                await at.take("tablet")
        await _recorded(browser, run, folder)
        await browser.close()


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, default=PICTURE.parent, help="folder of the pictures")
    folder: Path = parser.parse_args().into
    with tempfile.TemporaryDirectory(prefix="dlokit-") as run:
        asyncio.run(taken(Path(run) / "I-to-U", folder))


if __name__ == "__main__":
    main()
