"""`dlokit calibrate stereo`: the optics of a camera or a stereo pair, from pictures of a board."""

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from dlokit.app.calibrate.common import (
    HeldBoardArgs,
    input_error,
    keep_pictures,
    rehearse_in_hand,
    result_folder,
    seen_in_hand,
)
from dlokit.app.calibrate.folder import CALIBRATION
from dlokit.app.commands import CliCommand
from dlokit.errors import SkillFailure
from dlokit.functional.cameras.calibration_file import CalibrationResidual, write_calibration
from dlokit.skills.perception.calibration.stereo_rig import RigFit, calibrate_rig

POSES = 40


@dataclass(frozen=True, kw_only=True)
class StereoArgs(HeldBoardArgs):
    """Calibrate focal lengths, centre, lens distortion and baseline of the camera, from pictures of a ChArUco board.

    Show the board at all distances at which DLOs are seen, in all parts of the picture, tilted to all sides; who holds
    it does not matter. A folder without right_NAME.png calibrates a single camera.

    Try
      dlokit calibrate stereo                                   in the simulated cell
      dlokit calibrate stereo --from pictures --serial 7F2A --board.square-m 0.0298
      dlokit calibrate handeye --intrinsics runs/<time>-calibrate-stereo/calibration.toml

    Writes calibration.toml, whose pose of the camera is none yet, and the pictures of the cell.
    Exit code: 0; 3 when a dry run refuses a motion; 2 when the pictures do not give a calibration; 130 after Ctrl-C.
    """

    poses: int = POSES
    """Poses of the simulated arm; at least 10. More: a better result, about 0.3 s each."""


def run(args: StereoArgs) -> int:
    """Take or read the pictures, calibrate, print and write."""
    console = Console()
    if args.dry_run:
        return rehearse_in_hand(args, args.poses, console)
    folder = result_folder(args, "stereo")
    try:
        seen = seen_in_hand(args, args.poses, console)
        keep_pictures(args, folder, seen)
        fit = calibrate_rig(seen.shots, args.board, seen.camera)
    except SkillFailure as failure:
        raise input_error(failure) from failure
    _print(fit, console)
    residual = CalibrationResidual(method="optics", pictures=len(seen.shots), rms_px=fit.rms_px)
    write_calibration(folder / CALIBRATION, fit.camera, residual)
    console.print(f"written: {folder / CALIBRATION}", highlight=False, markup=False, soft_wrap=True)
    return 0


def _print(fit: RigFit, console: Console) -> None:
    camera = fit.camera
    table = Table(title=f"optics, from {fit.corners} corners with an error of {fit.rms_px:.3f} px")
    table.add_column("")
    table.add_column("value", justify="right")
    table.add_row("focal lengths, px", f"{camera.fx_px:.2f}, {camera.fy_px:.2f}")
    table.add_row("centre, px", f"{camera.cx_px:.2f}, {camera.cy_px:.2f}")
    if camera.baseline_m is not None:
        table.add_row("baseline, mm (by the nominal print)", f"{camera.baseline_m * 1e3:.3f}")
    for name, lens in (("left", camera.distortion), ("right", camera.distortion_right)):
        if lens is not None:
            table.add_row(f"{name} lens, k1 k2 p1 p2", " ".join(f"{value:+.4f}" for value in lens[:4]))
    console.print(table)


COMMAND = CliCommand(StereoArgs, run)
