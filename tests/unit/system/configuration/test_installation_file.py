"""Installation files: what they say ends in the configuration, and what is wrong in them is named."""

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from dlokit.description.installation import PAPERS_CELL, InstalledArm, InstalledTable, Place
from dlokit.errors import ConfigError
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.geometry.camera import project
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_checks import MIDDLE_M, check_installation
from dlokit.system.configuration.installation_file import InstalledCamera, with_installation
from dlokit.system.configuration.preflight import camera_of_cell
from dlokit.system.configuration.toml_config import from_toml, to_toml

ROOT = Path(__file__).parents[4]


def read(tmp_path: Path, text: str) -> RunConfig:
    file = tmp_path / "lab.toml"
    file.write_text(text)
    return with_installation(RunConfig(), file)


def test_an_empty_file_is_the_papers_cell(tmp_path: Path) -> None:
    assert read(tmp_path, "") == RunConfig()


def test_the_file_in_the_documentation_is_the_papers_cell_with_one_arm(tmp_path: Path) -> None:
    page = (ROOT / "docs/how-to/describe-an-installation.md").read_text()
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    said = read(tmp_path, text)
    assert said.installation.table == PAPERS_CELL.table
    assert said.installation.arms == PAPERS_CELL.arms[:1]
    assert (said.camera, said.calibration) == (RunConfig().camera, "")


def test_the_documentation_names_every_key_of_the_file_and_the_frame_of_each_place() -> None:
    page = (ROOT / "docs/how-to/describe-an-installation.md").read_text()
    blocks = re.findall(r"```(?:toml|text)\n(.*?)```", page, re.DOTALL)
    _, in_camera = "\n".join(blocks).split("[camera]")
    for part in (InstalledCamera, InstalledArm, InstalledTable):
        for field in fields(part):
            text = in_camera if part is InstalledCamera else "".join(blocks)
            assert re.search(rf"^{field.name} = |\[(\w+\.)?{field.name}\]", text, re.MULTILINE), (part, field.name)
    in_installation, in_world = page.split("**The installation's frame**")[1].split("**The world frame**")
    assert "`position_m`, `rpy_deg`, `look_at_m`" in in_installation
    assert "All places in the file" not in in_installation
    assert "`centre_m` of the table, the workspace of an arm, and `[[fixtures]]`" in in_world


def test_a_calibration_does_not_move_a_simulated_camera_and_a_ruler_does(tmp_path: Path) -> None:
    def stands(text: str) -> list[float]:
        run = read(tmp_path, text)
        return camera_of_cell(run).T_world_camera.position_m.tolist()

    papers = stands("")
    write_calibration(tmp_path / "eye.toml", camera_of_cell(read(tmp_path, "[camera]\nposition_m = [0.5, 0.0, 1.2]\n")))
    assert stands('[camera]\ncalibration = "eye.toml"\n') == papers
    assert stands("[camera]\nposition_m = [0.5, 0.0, 1.2]\n") == [0.5, 0.0, 1.2]


def test_the_page_about_arms_does_not_deny_that_two_may_be_of_different_models() -> None:
    file = ROOT / "examples/installations/panda_and_ur5e.toml"
    installation = with_installation(RunConfig(), file).installation
    assert [arm.model for arm in installation.arms] == ["panda", "ur5e"]
    assert "are of one model" not in (ROOT / "docs/how-to/add-an-arm.md").read_text()


def test_the_example_raises_the_table() -> None:
    run = with_installation(RunConfig(), ROOT / "examples/installations/raised.toml")
    assert run.installation.in_world(run.installation.arms[0].pose).position_m[2] == pytest.approx(-0.08, abs=1e-4)
    assert np.degrees(run.mounts[0].model.home_q_rad[0]) == pytest.approx(-90.0)


def test_a_camera_looks_at_the_point_that_the_file_names(tmp_path: Path) -> None:
    run = read(tmp_path, "[camera]\nposition_m = [0.9, -0.3, 1.1]\nlook_at_m = [0.5, 0.1, 0.2]\n")
    camera = camera_of_cell(run)
    projection = project([[0.5, 0.1, 0.2], [0.5, 0.1, 0.3]], camera)
    centre = [camera.cx_px, camera.cy_px]
    np.testing.assert_allclose(projection.pixels[0], centre, atol=1e-3)
    above = projection.pixels[1] - centre
    assert above[1] < -10.0
    assert abs(above[0]) < 1e-3  # upright: what is higher is above in the picture
    assert from_toml(to_toml(run), RunConfig, "config.toml") == run


def test_a_camera_that_looks_straight_down_is_that_of_the_page(tmp_path: Path) -> None:
    run = read(tmp_path, "[camera]\nposition_m = [0.5, 0.0, 1.0]\nlook_at_m = [0.5, 0.0, 0.0]\n")
    assert run.installation.camera == Place(position_m=(0.5, 0.0, 1.0), rpy_deg=(180.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "said",
    [
        "position_m = [0.5, 0.0, 1.0]\nlook_at_m = [0.5, 0.0, 0.0]\nrpy_deg = [180.0, 0.0, 0.0]\n",
        "position_m = [0.5, 0.0, 1.0]\nlook_at_m = [0.5, 0.0, 1.0]\n",
        "look_at_m = [0.5, 0.0, 0.0]\n",
        'calibration = "eye.toml"\nlook_at_m = [0.5, 0.0, 0.0]\n',
    ],
)
def test_a_point_to_look_at_goes_with_a_position_alone(said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="look_at_m"):
        read(tmp_path, "[camera]\n" + said)


EXAMPLES = sorted((ROOT / "examples/installations").glob("*.toml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_every_example_reaches_and_sees_the_table(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    run = with_installation(RunConfig(), file)
    check_installation(replace(run, arms=min(2, len(run.installation.arms))))
    assert [record.getMessage() for record in caplog.records] == []


def test_the_arm_at_the_side_has_the_middle_of_the_table_before_it() -> None:
    run = with_installation(RunConfig(), ROOT / "examples/installations/side.toml")
    middle = run.installation.in_world(Place(position_m=(0.0, 0.0, 0.0)).pose)
    np.testing.assert_allclose(middle.position_m, [*MIDDLE_M, 0.0], atol=1e-9)
    np.testing.assert_allclose(run.installation.table.centre_m, MIDDLE_M, atol=1e-9)
    pixels = project([[*MIDDLE_M, 0.0]], camera_of_cell(run)).pixels[0]
    np.testing.assert_allclose(pixels, [319.5, 279.5], atol=0.01)


def test_a_run_repeats_from_its_configuration_without_the_file() -> None:
    run = with_installation(RunConfig(), ROOT / "examples/installations/raised.toml")
    assert from_toml(to_toml(run), RunConfig, "config.toml") == run


def test_a_camera_comes_with_its_settings_and_the_calibration_beside_the_file(tmp_path: Path) -> None:
    said = '[camera]\ncalibration = "eye.toml"\n[camera.driver]\nkind = "realsense"\nserial = "0123"\n'
    run = read(tmp_path, said)
    assert run.camera == RealSenseConfig(serial="0123")
    assert run.calibration == str(tmp_path / "eye.toml")
    assert run.installation.camera is None


def test_a_camera_may_stand_where_a_ruler_has_it(tmp_path: Path) -> None:
    run = read(tmp_path, "[table]\nposition_m = [0.0, 0.0, 0.5]\n[camera]\nposition_m = [0.5, 0.0, 1.5]\n")
    assert run.installation.camera is not None
    assert run.installation.in_world(run.installation.camera.pose).position_m.tolist() == [0.5, 0.0, 1.0]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[table]\nheight_m = 0.08\n", "height_m"),
        ("[[arms]]\npostion_m = [0.0, 0.0, 0.0]\n", r"arms\[0\]: unknown key postion_m"),
        ('[[arms]]\nmodel = "kuka"\n', "kuka"),
        ("[[arms]]\n[[arms]]\n[[arms]]\n", "3 "),
        ('[camera]\ncalibration = "a.toml"\nposition_m = [0.0, 0.0, 1.0]\n', "leave one out"),
        ('[camera.driver]\nkind = "webcam"\n', "webcam"),
        ("table\n", "not TOML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ConfigError, match=named) as error:
        read(tmp_path, text)
    assert "lab.toml" in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="describe-an-installation"):
        with_installation(RunConfig(), tmp_path / "lab.toml")
