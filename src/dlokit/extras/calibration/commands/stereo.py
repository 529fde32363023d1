"""`dlokit calibrate stereo`: the optics of a camera or a stereo pair, from pictures of a board."""

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from dlokit.app.commands import CliCommand
from dlokit.app.console import say
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.commands.common import (
    HeldBoardArgs,
    input_error,
    keep_pictures,
    rehearse_in_hand,
    seen_in_hand,
)
from dlokit.extras.calibration.commands.folder import CALIBRATION
from dlokit.extras.calibration.procedure import FEWEST_SHOTS
from dlokit.extras.calibration.rig_quality import corners_deviation_m, held_out_rig
from dlokit.extras.calibration.stereo_rig import BoardShot, RigFit, calibrate_rig
from dlokit.functional.cameras.calibration_file import CalibrationResidual, write_calibration
from dlokit.geometry.camera import SIDES, camera_alone, turn_to_rectified
from dlokit.types.image import CameraCalibration

POSES = 40
_PERCENTILE = 95.0


@dataclass(frozen=True, kw_only=True)
class StereoArgs(HeldBoardArgs):
    """Calibrate focal lengths, centre, lens distortion and baseline of the camera, from pictures of a ChArUco board.

    Show the board at all distances at which DLOs are seen, in all parts of the picture, tilted to all sides; an arm
    or a person may hold it. A folder without right_NAME.png calibrates a single camera. The two cameras of a pair may
    differ and need not be parallel: the file then also has the rectification of their pictures, and its other values
    refer to the rectified pictures.

    Try
      dlokit calibrate stereo                                   in the simulated cell
      dlokit calibrate stereo --separate-cameras                two cameras on a bracket
      dlokit calibrate stereo --from pictures --serial 7F2A --board.square-m 0.0298
      dlokit calibrate handeye --intrinsics runs/<time>-calibrate-stereo/calibration.toml

    Writes calibration.toml, which does not have the camera's pose yet, and the pictures of the cell.
    Exit code: 0; 3 when a dry run refuses a motion; 2 when the pictures do not give a calibration; 130 after Ctrl-C.
    """

    poses: int = POSES
    """Poses of the simulated arm; at least 10. More: a better result, about 0.3 s each."""


def run(args: StereoArgs) -> int:
    """Take or read the pictures, calibrate, print and write."""
    console = Console()
    if args.dry_run:
        return rehearse_in_hand(args, args.poses, console)
    folder = args.folder_for("calibrate-stereo")
    try:
        seen = seen_in_hand(args, args.poses, console)
        keep_pictures(args, folder, seen)
        fit = calibrate_rig(seen.shots, args.board, seen.camera)
    except SkillFailure as failure:
        raise input_error(failure) from failure
    residual = _residual(seen.shots, args.board, seen.camera, fit)
    _print(fit, residual, console)
    write_calibration(folder / CALIBRATION, fit.camera, residual)
    say(console, f"written: {folder / CALIBRATION}")
    return 0


def _residual(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, fit: RigFit
) -> CalibrationResidual:
    """Accuracy of the optics; for a pair also in space, and in held-out pictures."""
    residual = CalibrationResidual(method="optics", pictures=len(shots), rms_px=fit.rms_px)
    if fit.camera.baseline_m is None:
        return residual
    residual = msgspec.structs.replace(residual, corners_m=float(corners_deviation_m(fit, shots, board).max()))
    if len(shots) < FEWEST_SHOTS:
        return residual
    apart = held_out_rig(shots, board, camera)
    if len(apart.rows_px) == 0:
        return residual
    return msgspec.structs.replace(
        residual,
        rows_px=float(np.percentile(apart.rows_px, _PERCENTILE)),
        board_m=float(np.percentile(apart.board_m, _PERCENTILE)),
    )


def _print(fit: RigFit, residual: CalibrationResidual, console: Console) -> None:
    camera = fit.camera
    sides = SIDES if camera.baseline_m is not None else SIDES[:1]
    alone = [camera_alone(camera, side) for side in sides]
    table = Table(title=f"optics, from {fit.corners} corners with an error of {fit.rms_px:.3f} px")
    for heading in ("", "left", "right")[: len(alone) + 1]:
        table.add_column(heading, justify="right" if heading else "left")
    table.add_row("focal lengths, px", *(f"{one.fx_px:.2f}, {one.fy_px:.2f}" for one in alone))
    table.add_row("centre, px", *(f"{one.cx_px:.2f}, {one.cy_px:.2f}" for one in alone))
    lenses = [np.zeros(5) if one.distortion is None else one.distortion for one in alone]
    table.add_row("lens, k1 k2 p1 p2", *(" ".join(f"{value:+.4f}" for value in lens[:4]) for lens in lenses))
    console.print(table)
    if camera.baseline_m is None:
        return
    kind = "parallel, with the same intrinsics" if fit.parallel else f"{_turn_deg(camera):.2f}° from parallel"
    say(console, f"the cameras are {camera.baseline_m * 1e3:.2f} mm apart (by the nominal print), {kind}")
    assert residual.corners_m is not None
    say(
        console,
        f"standard deviation of a point at the corners of the space that the boards have filled: at most "
        f"{residual.corners_m * 1e3:.2f} mm",
    )
    if residual.rows_px is not None and residual.board_m is not None:
        say(
            console,
            f"held-out pictures: the rows of a corner differ by {residual.rows_px:.2f} px, corners in space are "
            f"{residual.board_m * 1e3:.2f} mm off the board (95th percentile)",
        )


def _turn_deg(camera: CameraCalibration) -> float:
    """The angle between the two cameras [°]."""
    left, right = (turn_to_rectified(camera, side) for side in SIDES)
    return float(np.degrees(Rotation.from_matrix(left.T @ right).magnitude()))


COMMAND = CliCommand(StereoArgs, run)
