"""A recorded run in a real browser: played, paused and moved through with a real mouse on its timeline."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

from chromium import LONG_S, NEEDS_CHROMIUM, TEST_S, collect_errors, launched, new_page
from playwright.async_api import Page, async_playwright

from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.watching import WATCHED_PARTS, show

REFERENCE = Path(__file__).parents[1] / "replay" / "references" / "rollout.mcap"
ACTION_S, END_S = 0.3, 14.6
"""Beginning of its only action, and its end [s]."""

pytestmark = NEEDS_CHROMIUM


@asynccontextmanager
async def _a_page() -> AsyncGenerator[Page]:
    config = recorded_config(REFERENCE, WATCHED_PARTS)
    config = replace(config, viewer=replace(config.viewer, port=0))
    served = asyncio.get_running_loop().create_future()
    showing = asyncio.create_task(show(REFERENCE, config, 0.1, lambda said: served.set_result(said.split()[1])))
    async with async_playwright() as playwright:
        browser = await launched(playwright)
        try:
            page = await new_page(browser, 1000, 700)
            errors: list[str] = []
            collect_errors(page, errors)
            await page.goto(await asyncio.wait_for(served, LONG_S))
            await page.get_by_text("RECORDED RUN").wait_for()
            yield page
            assert errors == []
        finally:
            await browser.close()
            showing.cancel()
            await asyncio.wait({showing})


async def at(page: Page, position_s: float) -> None:
    """Wait until the page says this position."""
    drawing = page.locator(f'svg[data-position="{position_s:.1f}"]')
    await drawing.wait_for(state="attached")


async def _drag_slider(page: Page, part: float) -> None:
    thumb = page.get_by_role("slider").first
    box, track = await thumb.bounding_box(), await page.locator(".mantine-Slider-track").first.bounding_box()
    assert box is not None
    assert track is not None
    await page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    await page.mouse.down()
    await page.mouse.move(track["x"] + part * track["width"], track["y"] + track["height"] / 2, steps=3)
    await page.mouse.up()


def test_the_timeline_of_a_recorded_run_is_used_with_the_mouse() -> None:
    async def scenario(page: Page) -> None:
        assert await page.get_by_role("button", name="STOP").count() == 0
        await page.get_by_role("button", name="Pause").click()
        await page.get_by_role("button", name="Play").wait_for()
        await _drag_slider(page, 0.0)  # a slow browser may have seen the action begin
        await at(page, 0.0)
        await page.get_by_role("button", name="Next").click()
        await at(page, ACTION_S)
        await page.locator("[data-rollouts]").wait_for(state="attached")
        await page.get_by_role("button", name="Previous").click()
        await at(page, 0.0)
        await page.locator("[data-rollouts]").wait_for(state="detached")
        await _drag_slider(page, 1.0)
        await at(page, END_S)
        await page.locator("[data-state=ended]").wait_for()
        await _drag_slider(page, 0.0)
        await at(page, 0.0)
        await page.locator("[data-state=ended]").wait_for(state="detached")

    async def main() -> None:
        async with _a_page() as page:
            await asyncio.wait_for(scenario(page), TEST_S)

    asyncio.run(main())
