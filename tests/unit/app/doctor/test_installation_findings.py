"""What `dlokit doctor --installation` says of a file."""

from datetime import date
from pathlib import Path

import cv2
import msgspec
import pytest

from dlokit.app.doctor.installation import draw_installation, installation_findings
from dlokit.app.doctor.machine import Severity
from dlokit.description.default_cameras import default_calibration
from dlokit.errors import InputError
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_checks import check_installation
from dlokit.system.configuration.installation_file import with_installation

TODAY = date(2026, 11, 24)
REALSENSE = '[camera]\ncalibration = "camera.toml"\n[camera.driver]\nkind = "realsense"\nserial = "0123"\n'
DRIVER = '[camera.driver]\nkind = "realsense"\n'


def found(folder: Path, text: str, serials: list[str] | None = None) -> dict[str, tuple[Severity, str]]:
    path = folder / "lab.toml"
    path.write_text(text)
    rows = installation_findings(path, lambda driver: serials, TODAY)
    return {row.what: (row.standing, row.found) for row in rows}


def with_date(folder: Path, day: str) -> None:
    camera = default_calibration(640, 480)
    write_calibration(folder / "camera.toml", msgspec.structs.replace(camera, date=day, serial="0123"))


def test_a_good_installation_is_ready_and_tells_what_its_arms_reach(tmp_path: Path) -> None:
    rows = found(tmp_path, '[[arms]]\nname = "left"\n')
    assert {standing for standing, _ in rows.values()} == {Severity.READY}
    assert "90%" in rows["left arm"][1]


TURNED = "[[arms]]\nrpy_deg = [0.0, 0.0, 180.0]\n[arms.workspace]\nlower_m = [-0.9, -0.9, 0.0]\n"


def test_a_base_turned_away_from_the_table_is_named_though_it_reaches_most_of_it(tmp_path: Path) -> None:
    standing, said = found(tmp_path, TURNED)["first arm"]
    assert standing is Severity.ADVICE
    assert "over which its first joint comes to the end of its range" in said


def test_an_installation_that_works_in_part_is_a_warning_before_a_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text(TURNED + CAMERA.format("[0.7, 0.0, 0.9]", "[180.0, 0.0, 0.0]"))
    check_installation(with_installation(RunConfig(), file))
    arm, camera = (record.getMessage() for record in caplog.records)
    assert "turn its base by about 180°" in arm
    assert "the camera sees 45% of the usable table: the middle of its picture shows the table at x 0.70" in camera


CAMERA = "[camera]\nposition_m = {}\nrpy_deg = {}\n"


@pytest.mark.parametrize(
    ("position_m", "rpy_deg", "named"),
    [
        ("[0.5, -0.9, 0.9]", "[-100.0, 0.0, 0.0]", "sees 0% of the usable table"),
        ("[0.5, 0.0, 1.0]", "[3.1416, 0.0, 0.0]", "the file has radians: write [180.0, 0.0, 0.0]"),
        ("[500.0, 0.0, 1000.0]", "[180.0, 0.0, 0.0]", "correct position_m, [500.0, 0.0, 1000.0], of [camera]"),
        (
            "[0.5, 0.9, 0.9]",
            "[-140.0, 0.0, 0.0]",
            "in the file: position_m [0.5, 0.9, 0.9], rpy_deg [-140.0, 0.0, 0.0]",
        ),
    ],
)
def test_a_camera_that_sees_none_of_the_table_is_refused_in_the_numbers_of_the_file(
    position_m: str, rpy_deg: str, named: str, tmp_path: Path
) -> None:
    table = "[table]\nposition_m = [0.0, 0.0, 0.1]\n"
    standing, said = found(tmp_path, table + CAMERA.format(position_m, rpy_deg))["camera"]
    assert standing is Severity.LACKING
    assert named in said


@pytest.mark.parametrize(
    ("position_m", "named"),
    [
        ("[0.0, 300.0, -20.0]", "correct its position_m, [0.0, 300.0, -20.0], or that of [table], [0.0, 0.3, 0.0], in"),
        ("[0.0, 300.0, -20.0]", "both are in metres, not millimetres"),
        ("[0.0, 1.6, 0.0]", "1.60 m from the part of the table where DLOs lie"),
        ("[0.0, 0.3, -0.7]", "position_m [0.0, 0.3, -0.7] and rpy_deg [0.0, 0.0, -90.0] in the installation file, is"),
        ("[0.0, 0.3, -0.7]", "0.70 m below the top of the table. Correct its base;"),
    ],
)
def test_a_base_that_is_far_from_the_table_is_named_before_its_home(
    position_m: str, named: str, tmp_path: Path
) -> None:
    table = "[table]\nposition_m = [0.0, 0.3, 0.0]\nrpy_deg = [0.0, 0.0, -90.0]\n"
    arm = f"[[arms]]\nposition_m = {position_m}\nrpy_deg = [0.0, 0.0, -90.0]\n"
    standing, said = found(tmp_path, table + arm)["first arm"]
    assert standing is Severity.LACKING
    assert named in said


POST = '[[fixtures]]\nkind = "post"\nname = "{}"\nposition_m = [{}, {}, 0.0]\n'
TOWER = POST.format("tower", 0.29, 0.0) + "height_m = 0.5\ndiameter_m = 0.02\n"


@pytest.mark.heavy
def test_fixtures_are_counted_and_what_no_arm_reaches_is_named(tmp_path: Path) -> None:
    near, far = POST.format("near", 0.5, 0.0), POST.format("far", 1.0, 0.35)
    assert found(tmp_path, "[[arms]]\n" + near)["fixtures"] == (Severity.READY, "1: within reach of an arm")
    standing, said = found(tmp_path, "[[arms]]\n" + near + far)["fixtures"]
    assert (standing, said) == (Severity.ADVICE, "2: no arm reaches far")
    assert "fixtures" not in found(tmp_path, "")


def test_places_where_fixtures_leave_no_room_for_a_grasp_do_not_count_as_reached(tmp_path: Path) -> None:
    wall = '[[fixtures]]\nkind = "box"\nname = "wall"\nposition_m = [0.5, 0.0, 0.0]\nsize_m = [0.3, 0.5, 0.02]\n'
    free, built = (found(tmp_path, text)["first arm"][1] for text in ("[[arms]]\n", "[[arms]]\n" + wall))
    assert "90%" in free
    assert int(built.split("reaches ")[1].split("%")[0]) <= 70


@pytest.mark.parametrize(
    ("text", "what", "named"),
    [
        (TOWER, "first arm", "hand would come to"),
        ("[[arms]]\n[[arms]]\n", "arms", "same place"),
        ("[[arms]]\n[[arms]]\nposition_m = [0.0, 0.25, 0.0]\n", "arms", "at home"),
        ("[[arms]]\nposition_m = [0.5, 0.1, 0.0]\n", "first arm", "where DLOs lie"),
        ("[[arms]]\n[arms.workspace]\nlower_m = [-0.3, -0.9, 0.4]\n", "first arm", "can grasp nowhere"),
        ("[[arms]]\n[arms.workspace]\nlower_m = [0.5, -0.9, 0.0]\n", "first arm", "outside its workspace"),
        ('[[arms]]\nmodel = "robot.toml"\n', "lab.toml", "no such file"),
        ("[camera]\nposition_m = [0.5, 0.0, 1.0]\n", "camera", "looks away"),
        ("[camera]\nposition_m = [0.5, 0.0, -1.0]\n", "camera", "below the top"),
        ('[camera]\ncalibration = "none.toml"\n', "camera", "none.toml"),
        ("[table]\nheight = 3\n", "lab.toml", "unknown key height"),
    ],
)
def test_what_is_wrong_has_one_clear_error(text: str, what: str, named: str, tmp_path: Path) -> None:
    standing, said = found(tmp_path, text)[what]
    assert standing is Severity.LACKING
    assert named in said


def test_a_camera_is_looked_for_by_its_serial(tmp_path: Path) -> None:
    with_date(tmp_path, "2026-11-01")
    seen = "realsense 0123; sees 100% of the usable table"
    assert found(tmp_path, REALSENSE, ["0123"])["camera"] == (Severity.READY, seen)
    standing, said = found(tmp_path, REALSENSE, ["0999"])["camera"]
    assert standing is Severity.LACKING
    assert "0999" in said


@pytest.mark.parametrize(
    ("serials", "standing", "says"),
    [
        ([""], Severity.READY, "realsense, which reports no serial number"),
        (["", ""], Severity.LACKING, "2 are connected (one without a serial number, one without a serial number)"),
        (["0123", "0124"], Severity.LACKING, "2 are connected (0123, 0124), and [camera.driver] names none"),
    ],
)
def test_cameras_without_a_serial_and_several_of_which_none_is_named_are_told_apart(
    tmp_path: Path, serials: list[str], standing: Severity, says: str
) -> None:
    said = found(tmp_path, "[camera]\nposition_m = [0.5, 0.0, 1.0]\nrpy_deg = [180.0, 0.0, 0.0]\n" + DRIVER, serials)
    assert said["camera"][0] is standing
    assert says in said["camera"][1]


def test_a_camera_without_a_serial_is_not_the_one_that_the_file_names(tmp_path: Path) -> None:
    with_date(tmp_path, "2026-11-01")
    standing, said = found(tmp_path, REALSENSE, [""])["camera"]
    assert standing is Severity.LACKING
    assert said == "realsense 0123 is not connected; connected: one without a serial number"


def test_an_old_calibration_is_worth_repeating(tmp_path: Path) -> None:
    for day, standing in (("2026-11-01", Severity.READY), ("2026-01-01", Severity.ADVICE)):
        with_date(tmp_path, day)
        assert found(tmp_path, REALSENSE, ["0123"])["calibration"][0] is standing


def test_a_calibration_whose_residual_cannot_be_read_is_a_row_of_the_table(tmp_path: Path) -> None:
    with_date(tmp_path, "2026-11-01")
    with (tmp_path / "camera.toml").open("a") as file:
        file.write('\n[residual]\nrms_px = "small"\n')
    standing, said = found(tmp_path, REALSENSE, ["0123"])["calibration"]
    assert standing is Severity.LACKING
    assert "[residual]" in said


def test_the_picture_of_an_installation_has_the_cell_and_the_cameras_view(tmp_path: Path) -> None:
    file, picture = tmp_path / "lab.toml", tmp_path / "lab.png"
    file.write_text(CAMERA.format("[0.5, 0.0, 1.2]", "[180.0, 0.0, 0.0]"))
    draw_installation(file, picture)
    pixels = cv2.imread(str(picture))
    assert pixels is not None
    height = len(pixels)
    views = pixels[:, : height * 4 // 3], pixels[:, height * 4 // 3 :]
    assert views[1].shape == (RunConfig().cell.height_px, RunConfig().cell.width_px, 3)
    assert all(view.std() > 10.0 for view in views)


def test_a_picture_whose_folder_does_not_exist_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        draw_installation(tmp_path / "lab.toml", tmp_path / "none" / "lab.png")
