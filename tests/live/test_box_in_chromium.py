"""`dlokit calibrate box` in a real browser: corners dragged with a real mouse, lines for the installation file."""

import asyncio
import io
from pathlib import Path

import msgspec
import numpy as np
import pytest
from chromium import NEEDS_CHROMIUM, TEST_S, drawn, launched, new_page
from playwright.async_api import Page, async_playwright
from rich.console import Console

from dlokit import geometry
from dlokit.description.installation import Installation
from dlokit.description.shapes import builtin_shape
from dlokit.extras.calibration.box_page import FIT, FROM_M, GIZMO_M, LOOK_AT_M, WRITE, ChosenBox
from dlokit.extras.calibration.commands.box import Choosing, ChosenPlaces
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.skills.viewer.viewpoint import VISITOR_FOV_RAD
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.types.arrays import Float64Array
from dlokit.types.image import StereoImages

pytestmark = NEEDS_CHROMIUM
LIFTED_M = 0.08


@pytest.fixture(scope="module")
def pictures() -> StereoImages:
    """A pair of the cell, in a frame of the lab that is 80 mm below the table."""
    cell = Cell(CellConfig(camera_error_m=0.0, camera_error_deg=0.0), seed=0)
    cell.place_dlo(builtin_shape("S", 0.5, 100), settle=False)
    images = cell.capture()
    cell.close()
    T = geometry.lifted(images.calibration.T_world_camera, LIFTED_M)
    return msgspec.structs.replace(images, calibration=msgspec.structs.replace(images.calibration, T_world_camera=T))


def test_the_plane_is_fitted_a_corner_dragged_and_the_lines_are_those_of_an_installation(
    pictures: StereoImages, tmp_path: Path
):
    chosen = asyncio.run(asyncio.wait_for(used(pictures), TEST_S))
    assert chosen.plane is not None
    assert chosen.plane.frame.position_m[2] == pytest.approx(LIFTED_M, abs=4e-3)
    assert np.degrees(chosen.plane.tilt_rad) < 0.6
    assert chosen.box.upper_m[2] > 0.35  # it was 0.3 before the drag
    file = tmp_path / "installation.toml"
    file.write_text(chosen.lines(None))
    found: Installation = with_installation(RunConfig(), file).installation
    assert found.table.position_m[2] == pytest.approx(LIFTED_M, abs=4e-3)
    assert found.arms[0].workspace.upper_m == pytest.approx(chosen.box.upper_m, abs=1e-4)


async def drag_upper_corner(page: Page, box: ChosenBox) -> None:
    """Pull the arrow that points upwards, with the mouse."""
    await drawn(page)
    up = np.array([0.0, 0.0, 1.0])
    grip = await pixel(page, box.place(1) + 0.5 * GIZMO_M * up)
    end = await pixel(page, box.place(1) + (0.5 * GIZMO_M + 0.12) * up)
    await page.mouse.move(*grip)
    await drawn(page)  # the gizmo answers only after the browser has drawn it as hovered
    await page.mouse.down()
    await page.mouse.move(*end, steps=4)
    await page.mouse.up()


async def pixel(page: Page, point: Float64Array) -> tuple[float, float]:
    """Where a point (3,) [m] of the scene is on the page [px]."""
    box = await page.locator("canvas").first.bounding_box()
    assert box is not None
    forward = np.array(LOOK_AT_M) - np.array(FROM_M)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    offset = point - np.array(FROM_M)
    focal_px = box["height"] / 2.0 / np.tan(VISITOR_FOV_RAD / 2.0) / float(offset @ forward)
    down = np.cross(forward, right)
    return (
        box["x"] + box["width"] / 2.0 + float(offset @ right) * focal_px,
        box["y"] + box["height"] / 2.0 + float(offset @ down) * focal_px,
    )


async def used(pictures: StereoImages) -> ChosenPlaces:
    """What a person does on the page."""
    said = io.StringIO()
    choosing = Choosing(pictures, Console(file=said, width=300), 0)
    serving = asyncio.create_task(choosing.chosen())
    try:
        while "viewer: " not in said.getvalue():
            await asyncio.sleep(0.01)
            assert not serving.done(), serving
        async with async_playwright() as playwright:
            browser = await launched(playwright)
            page = await new_page(browser, 1000, 600)
            await page.goto(said.getvalue().split()[1])
            await page.get_by_role("button", name=FIT).click()
            await page.get_by_text("mm off it").wait_for()
            while choosing.box.upper_m[2] < 0.35:
                await drag_upper_corner(page, choosing.box)
            await page.get_by_role("button", name=WRITE).click()
            chosen = await serving
            await browser.close()
        return chosen
    finally:
        serving.cancel()
