"""Take the picture of README: a live run at its end, in the browser, beside what its report shows.

    python tests/helpers/run_picture.py

The simulated arm brings a rope from I to S with seed 0; then a headless Chromium opens the viewer's page, as a visitor
has it, and the report. Writes docs/images/run.jpg. About two minutes on an idle machine.
"""

import asyncio
import io
import os
import re
import sys
import tempfile
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from chromium import launched, new_page
from PIL import Image
from playwright.async_api import Browser, Page, async_playwright

PICTURE = Path(__file__).parents[2] / "docs" / "images" / "run.jpg"
LIMIT_S = 600.0
"""Longest wait for anything: software rendering on a busy machine is slow [s]."""
PAGE_PX = (1130, 908)
"""Width and height of the browser's window: so high that the camera's picture is complete below the panel."""
REPORT_PX = (1020, 900)
"""The narrowest window in which the report has two columns, so that its letters stay large in the picture."""
SECTIONS = ("Before", "Shapes on the table, from above")
"""What is taken of the report, from top to bottom."""
SETTLE_S = 15.0
"""The page goes on drawing after it has said that the task has ended [s]."""
GAP_PX = 8
BACKGROUND = "#f6f7f9"
LARGEST_BYTES = 400_000


@asynccontextmanager
async def page_of(*command: str, until: str) -> AsyncGenerator[str]:
    """Run `dlokit` with the words of a command until the block ends; yields the address of its page.

    Waits until it has printed `until`, which comes no earlier than the address.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "dlokit", *command, "--port", "0"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env={**os.environ, "COLUMNS": "200"},  # the address stands in one line
    )
    assert process.stdout is not None
    try:
        async with asyncio.timeout(LIMIT_S):
            said = ""
            while until not in said:
                line = (await process.stdout.readline()).decode()
                if not line:
                    raise RuntimeError(f"the run ended:\n{said}")
                said += line
        (url,) = re.findall(r"viewer: (http://\S+)\n", said)
        reading = asyncio.create_task(process.stdout.read())  # a full pipe would hold the run
        yield url
    finally:
        if process.returncode is None:
            process.terminate()
            await process.wait()
    await reading


async def taken(folder: Path) -> tuple[Image.Image, list[Image.Image]]:
    """The page at the end of a task, and the sections of its report. `folder` does not exist yet."""
    command = (
        "shape",
        "--runtime",
        "live",
        "--start",
        "I",
        "--goal",
        "S",
        "--seed",
        "0",
        "--stay",
        "--out",
        str(folder),
    )
    # A browser that draws beside the arm takes the time of the cell's camera where there is no GPU.
    async with page_of(*command, until="waiting for the next goal") as url, async_playwright() as playwright:
        browser = await launched(playwright)
        page = await _page(browser, url)
        report = await _sections(browser, folder / "task-1" / "report.html")
        await browser.close()
    return page, report


async def _page(browser: Browser, url: str) -> Image.Image:
    page = await new_page(browser, *PAGE_PX)
    page.set_default_timeout(LIMIT_S * 1000)
    await page.goto(url)
    end = page.locator('[data-end="1"]')
    await end.wait_for()
    if "Task 1, to S: converged" not in await end.inner_text():
        raise RuntimeError(f"the task did not converge: {await end.inner_text()}")
    await page.get_by_role("tab", name="Look").click()
    await without_notices(page)
    return image_of(await page.screenshot())


async def without_notices(page: Page) -> None:
    """Close what viser says of a machine without a GPU, and wait until the page has drawn everything."""
    notice = page.locator(".mantine-Notification-closeButton")
    await page.wait_for_timeout(SETTLE_S * 1000)
    for _ in range(await notice.count()):
        await notice.first.click()
    await page.wait_for_timeout(SETTLE_S * 1000)


async def _sections(browser: Browser, report: Path) -> list[Image.Image]:
    page = await new_page(browser, *REPORT_PX)
    page.set_default_timeout(LIMIT_S * 1000)
    await page.goto(report.as_uri())
    sections = [page.locator("section", has=page.get_by_role("heading", name=name, exact=True)) for name in SECTIONS]
    return [image_of(await section.screenshot()) for section in sections]


def image_of(png: bytes) -> Image.Image:
    """A screenshot as a picture."""
    return Image.open(io.BytesIO(png)).convert("RGB")


def joined(page: Image.Image, sections: list[Image.Image]) -> Image.Image:
    """The page, and at its right the sections one below the other, as wide as makes them as high together."""
    free_px = page.height - GAP_PX * (len(sections) - 1)
    width_px = int(free_px / sum(section.height / section.width for section in sections))
    whole = Image.new("RGB", (page.width + GAP_PX + width_px, page.height), BACKGROUND)
    whole.paste(page, (0, 0))
    top_px = 0
    for section in sections:
        height_px = int(width_px * section.height / section.width)
        smaller = section.resize((width_px, height_px), Image.Resampling.LANCZOS)
        whole.paste(smaller, (page.width + GAP_PX, top_px))
        top_px += height_px + GAP_PX
    return whole


def main() -> None:
    """Run the task, and write the picture."""
    with tempfile.TemporaryDirectory(prefix="dlokit-") as folder:
        picture = joined(*asyncio.run(taken(Path(folder) / "I-to-S")))
    picture.save(PICTURE, quality=88, optimize=True, progressive=True)
    size = PICTURE.stat().st_size
    print(f"{PICTURE}: {picture.width}×{picture.height} px, {size / 1000.0:.0f} kB")
    if size > LARGEST_BYTES:
        raise RuntimeError(f"the picture has {size} bytes; README may show at most {LARGEST_BYTES}")


if __name__ == "__main__":
    main()
