"""Checks of an installation file by `dlokit doctor --installation`: its arms, its camera, the age of a calibration."""

from collections.abc import Callable, Iterator, Sequence
from datetime import date
from importlib.util import find_spec
from pathlib import Path

from dlokit.app.doctor.machine import DoctorRow, Severity, connected_serials
from dlokit.errors import DlokitError, InputError, install_command, require_cell
from dlokit.functional.cameras.calibration_file import (
    CalibrationResidual,
    check_has_pose,
    check_same_camera,
    read_calibration,
    read_part,
)
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation

PICTURE_FORMATS = (".png", ".jpg")
_OLD_DAYS = 180
"""A calibration older than this is worth repeating: a bracket that was touched once is off by millimetres [days]."""

ConnectedSerials = Callable[[str], Sequence[str] | None]
"""From a driver's name to the serials of its cameras that are connected; None where it cannot be asked."""


def installation_findings(
    path: Path, connected: ConnectedSerials | None = None, today: date | None = None
) -> tuple[DoctorRow, ...]:
    """Check a file and everything that it names."""
    try:
        run = _with_all_arms(path)
    except DlokitError as error:
        return (_wrong(path.name, error),)
    rows = [DoctorRow(path.name, Severity.READY, f"{run.arms} arms" if run.arms > 1 else "1 arm")]
    if find_spec("mujoco") is None:
        said = "arms and camera are not checked: MuJoCo is not installed"
        return (*rows, DoctorRow("arms", Severity.OPTIONAL, said, install_command("all")))
    return (*rows, *_arms(run), _camera(run, connected or connected_serials), *_calibration(run, today or date.today()))


def draw_installation(path: Path, picture: Path) -> None:
    """Draw the cell of an installation file as a person at the table sees it, beside the view of its camera.

    The arms are at home. The view is omitted where the file does not say where the camera is. Raises `ConfigError`
    for a file or a cell that cannot be, `MachineError` without MuJoCo or OpenGL, `InputError` for a picture that cannot
    be written.
    """
    require_cell("--picture")
    import cv2
    import numpy as np

    from dlokit.functional.cell.rendering import viewpoint_camera
    from dlokit.functional.cell.world import Cell

    run = _with_all_arms(path)
    mounts, installation = run.scene.arms, run.installation
    height_px = run.cell.height_px
    viewpoint = viewpoint_camera(height_px * 4 // 3, height_px, installation, mounts[0])
    cell = Cell(run.cell, seed=0, arms=mounts, installation=installation, viewpoint=viewpoint)
    try:
        views = [cell.view()]
        if not run.calibration and (run.camera.sees_cell or installation.camera is not None):
            views.append(cell.camera_view())
    finally:
        cell.close()
    if not cv2.imwrite(str(picture), cv2.cvtColor(np.hstack(views), cv2.COLOR_RGB2BGR)):
        raise InputError(f"The picture {picture} cannot be written: is its folder there?")


def _with_all_arms(path: Path) -> RunConfig:
    """A run with all that a file describes, and the defaults for the rest. Raises `ConfigError`."""
    run = with_installation(RunConfig(), path)
    return RunConfig(
        installation=run.installation,
        camera=run.camera,
        calibration=run.calibration,
        arms=2 if len(run.installation.arms) == 2 else 1,
    )


def _wrong(what: str, error: Exception) -> DoctorRow:
    return DoctorRow(what, Severity.LACKING, str(error))


def _arms(run: RunConfig) -> Iterator[DoctorRow]:
    from dlokit.system.configuration import installation_checks as checks  # loads the kinematics

    try:
        mounts = run.scene.arms
    except DlokitError as error:
        yield _wrong("arms", error)
        return
    for mount in mounts:
        what = f"{mount.robot} arm"
        try:
            reach = checks.check_arm(mount, run.installation)
        except DlokitError as error:
            yield _wrong(what, error)
            continue
        standing = Severity.ADVICE if reach.advice else Severity.READY
        yield DoctorRow(what, standing, f"{mount.model.title}; {reach.text}", reach.advice)
    try:
        checks.check_arms_apart(mounts, run.robot.arm_clearance_m)
    except DlokitError as error:
        yield _wrong("arms", error)
    if fixtures := run.installation.fixtures:
        far = checks.beyond_reach(mounts, fixtures)
        said = f"{len(fixtures)}: " + (f"no arm reaches {', '.join(far)}" if far else "within reach of an arm")
        fix = "correct its position_m in [[fixtures]]" if far else ""
        yield DoctorRow("fixtures", Severity.ADVICE if far else Severity.READY, said, fix)


def _camera(run: RunConfig, connected: ConnectedSerials) -> DoctorRow:
    from dlokit.system.configuration.installation_checks import believed_camera_pose, check_camera

    what, camera = "camera", run.camera
    try:
        if run.calibration:
            check_has_pose(run.calibration, read_calibration(Path(run.calibration)))
        seen = check_camera(run)
        T_world_camera = believed_camera_pose(run)
        serials = connected(camera.name)
    except DlokitError as error:
        return _wrong(what, error)
    place = "" if T_world_camera is not None else "; only its driver knows its pose"
    advice = ""
    if seen is not None:
        place, advice = f"; {seen.text}", seen.advice
    standing = Severity.ADVICE if advice else Severity.READY
    if camera.sees_cell:
        return DoctorRow(what, standing, f"{camera.name}, of the simulated cell{place}", advice)
    if serials is None:
        return DoctorRow(what, standing, f"{camera.name}, not looked for here{place}", advice)
    wanted = _wanted_serials(run)
    missing = [serial for serial in wanted if serial not in serials]
    listed = ", ".join(serial or "one without a serial number" for serial in serials) or "none"
    if missing or not serials:
        said = f"{camera.name} {', '.join(missing)} is not connected; connected: {listed}"
        return DoctorRow(what, Severity.LACKING, said, "check power, cable and serial")
    if not _named_by_driver(run) and len(serials) > 1:
        said = f"{camera.name}: {len(serials)} are connected ({listed}), and [camera.driver] names none"
        fix = "name one there by its serial number" if any(serials) else "connect only the one to use"
        return DoctorRow(what, Severity.LACKING, said, fix)
    if not wanted and not serials[0]:
        return DoctorRow(what, standing, f"{camera.name}, which reports no serial number{place}", advice)
    return DoctorRow(what, standing, f"{camera.name} {', '.join(wanted) or serials[0]}{place}", advice)


def _wanted_serials(run: RunConfig) -> list[str]:
    """The serials that the file names, of its driver or, for want of one there, of its calibration."""
    named = _named_by_driver(run)
    if not named and run.calibration:
        named = read_calibration(Path(run.calibration)).serial.split("+")
    return [serial for serial in named if serial]


def _named_by_driver(run: RunConfig) -> list[str]:
    named = (str(getattr(run.camera, name, "")) for name in ("serial", "left", "right"))
    return [name for name in named if name]


def _calibration(run: RunConfig, today: date) -> Iterator[DoctorRow]:
    what = "calibration"
    if not run.calibration:
        if not run.camera.sees_cell:
            said = "none: the camera's pose is measured by a ruler, to a centimetre, or comes from its driver"
            fix = "dlokit calibrate handeye --installation FILE --from pictures"
            yield DoctorRow(what, Severity.ADVICE, said, fix)
        return
    try:
        calibration = read_calibration(Path(run.calibration))
        if run.camera.sees_cell:
            from dlokit.system.configuration.preflight import camera_of_cell

            check_same_camera(run.calibration, calibration, camera_of_cell(run))
        residual = read_part(Path(run.calibration), CalibrationResidual)
    except DlokitError as error:
        yield _wrong(what, error)
        return
    of = calibration.serial or "any camera: it names no serial"
    try:
        days = (today - date.fromisoformat(calibration.date)).days
    except ValueError:
        yield DoctorRow(what, Severity.READY, f"of {of}; no date")
        return
    said = f"of {of}, {calibration.date}, {days} days old" + (
        "" if residual is None else f", residual {residual.rms_px:.2f} px"
    )
    old = days > _OLD_DAYS
    fix = "dlokit calibrate handeye, again" if old else ""
    yield DoctorRow(what, Severity.ADVICE if old else Severity.READY, said, fix)
