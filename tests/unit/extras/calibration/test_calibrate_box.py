"""What `dlokit calibrate box` writes, and what it refuses; its page is used in tests/live."""

import asyncio
import io
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

from dlokit import geometry
from dlokit.app.commands import execute
from dlokit.description.default_cameras import default_calibration
from dlokit.errors import ConfigError, InputError
from dlokit.extras.calibration.box_page import ChosenBox
from dlokit.extras.calibration.commands.box import Choosing, ChosenPlaces
from dlokit.extras.calibration.plane_fit import PlaneFit
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.types.image import StereoImages

NORMAL = np.array([np.sin(0.02), 0.0, np.cos(0.02)])
PLANE = PlaneFit(normal=NORMAL, distance_m=0.08, rms_m=0.002, points=1000)
BOX = ChosenBox(frame=PLANE.frame, lower_m=(0.2, -0.4, 0.0), upper_m=(0.8, 0.4, 0.5))


def test_the_lines_give_the_plane_and_the_box_back_as_an_installation(tmp_path: Path):
    calibration, file = tmp_path / "calibration.toml", tmp_path / "installation.toml"
    write_calibration(calibration, default_calibration())
    file.write_text(ChosenPlaces(plane=PLANE, box=BOX).lines(calibration))
    run = with_installation(RunConfig(), file)
    table = geometry.matrix(run.installation.table.pose)
    np.testing.assert_allclose(table[:3, 2], NORMAL, atol=1e-5)
    assert float(NORMAL @ table[:3, 3]) == pytest.approx(0.08, abs=1e-4)
    assert run.installation.arms[0].workspace.lower_m == (0.2, -0.4, 0.0)
    assert run.installation.arms[0].workspace.upper_m == (0.8, 0.4, 0.5)
    assert run.calibration == str(calibration)


def test_without_a_fitted_plane_the_table_is_left_out():
    assert "[table]" not in ChosenPlaces(plane=None, box=BOX).lines(None)


@pytest.mark.live  # it serves its page
def test_a_box_without_table_in_it_is_named_on_the_page_and_changes_nothing():
    async def scenario() -> None:
        grey = np.full((560, 640, 3), 90, dtype=np.uint8)  # nothing to match
        blank = StereoImages(stamp_ns=1, left=grey, right=grey, calibration=default_calibration())
        choosing = Choosing(blank, Console(file=io.StringIO()), 0)
        serving = asyncio.create_task(choosing.chosen())
        try:
            while not choosing.shown:
                await asyncio.wait({serving}, timeout=0.01)
                if serving.done():
                    await serving  # raises why it is not served
            choosing.fit()
            choosing.write()
            assert (await serving).plane is None
        finally:
            serving.cancel()

    asyncio.run(scenario())


def test_a_camera_without_a_pose_and_another_one_of_the_cell_are_refused(tmp_path: Path):
    optics = tmp_path / "optics.toml"
    write_calibration(
        optics, msgspec.structs.replace(default_calibration(), T_world_camera=geometry.pose((0.0, 0.0, 0.0)))
    )
    with pytest.raises(ConfigError, match="optics alone"):
        execute(["calibrate", "box", "--calibration", str(optics), "--out", str(tmp_path / "a")])
    with pytest.raises(InputError, match="use --camera simulated"):
        execute(["calibrate", "box", "--camera", "simulated-d435", "--out", str(tmp_path / "b")])
