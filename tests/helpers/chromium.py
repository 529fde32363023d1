"""Chromium for tests of the viewer's pages: how it is started, its errors, and where a point of the scene appears."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from playwright.async_api import Browser, Page, Playwright

from dlokit.skills.viewer.viewpoint import VISITOR_FOV_RAD, VISITOR_LOOK_AT_M, viewpoint
from dlokit.types.arrays import Float64Array

_CHROMIUM = Path("/usr/bin/chromium")
_ARGUMENTS = [
    "--headless=new",
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--webgl-antialiasing-mode=none",  # in software it costs more than all else that is drawn
    "--webgl-msaa-sample-count=0",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
NEEDS_CHROMIUM = [
    pytest.mark.browser,
    pytest.mark.skipif(not _CHROMIUM.exists(), reason=f"{_CHROMIUM} is missing; on Debian: apt install chromium"),
]
"""Marks of a module whose tests use it."""
LONG_S = 120.0
"""Software rendering on a loaded machine takes seconds per image; no wait takes that long unless something fails."""
TEST_S = 600.0
"""No test of a page takes that long unless it hangs [s]."""
_ERRORS_OF_VISER = ("Unable to preventDefault inside passive event listener invocation.",)
"""viser's client logs these during any drag."""


async def launched(playwright: Playwright) -> Browser:
    """A new browser."""
    return await playwright.chromium.launch(executable_path=_CHROMIUM, args=_ARGUMENTS)


async def new_page(browser: Browser, width_px: int, height_px: int) -> Page:
    """An empty page, whose waits take at most `LONG_S`."""
    page = await browser.new_page(viewport={"width": width_px, "height": height_px})
    page.set_default_timeout(LONG_S * 1000)
    return page


def collect_errors(page: Page, errors: list[str]) -> None:
    """Append the errors of a page and its console to `errors`, without those that viser makes itself."""

    def note(kind: str, text: str) -> None:
        if kind == "error" and text not in _ERRORS_OF_VISER:
            errors.append(text)

    page.on("console", lambda message: note(message.type, message.text))
    page.on("pageerror", lambda error: note("error", str(error)))


async def drawn(page: Page) -> None:
    """Wait until the page has drawn what it knows; it has also sent what the mouse does, 20 times a second."""
    await page.evaluate(
        "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 60))))"
    )


async def pixel(page: Page, point_world: Float64Array) -> Float64Array:
    """Position of a point (3,) [m] on the page of a new visitor [px]."""
    box = await page.locator("canvas").first.bounding_box()
    assert box is not None
    eye = viewpoint(box["width"] / box["height"])
    right, down, forward = visitor_axes(eye)
    offset = point_world - eye
    focal_px = box["height"] / 2.0 / np.tan(VISITOR_FOV_RAD / 2.0)
    across = np.array([offset @ right, offset @ down]) / (offset @ forward) * focal_px
    return across + np.array([box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0])


async def draw_with_button_held(page: Page, corners: Sequence[tuple[float, float]]) -> None:
    """Draw a line through points x, y of the table [m]; the left button stays down."""
    places = [await pixel(page, np.array([x, y, 0.0])) for x, y in corners]
    await page.mouse.move(*places[0])
    await page.mouse.down()
    for before, place in pairwise(places):
        for part in np.linspace(0.2, 1.0, 5):
            await page.mouse.move(*(before + part * (place - before)))
            await drawn(page)


def visitor_axes(eye: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Right, down and forward (3,) each, of a visitor at `eye` (3,) [m]."""
    forward = np.array(VISITOR_LOOK_AT_M) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(forward, right), forward
