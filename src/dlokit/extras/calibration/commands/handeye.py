"""`dlokit calibrate handeye`: the pose of the camera, from a board in the hand of the arm."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.commands.common import (
    NO_SERIAL,
    HeldBoardArgs,
    Seen,
    input_error,
    keep_pictures,
    rehearse_in_hand,
    seen_in_hand,
    today,
)
from dlokit.extras.calibration.commands.folder import CALIBRATION
from dlokit.extras.calibration.commands.folder import POSES as POSES_FILE
from dlokit.extras.calibration.procedure import CalibratedPose, calibrate_pose, workspace_corners
from dlokit.functional.cameras.calibration_file import (
    CalibrationResidual,
    check_same_camera,
    read_calibration,
    write_calibration,
)
from dlokit.types.arrays import Float64Array

POSES = 25
"""Number of poses that gives the cell's camera pose to 0.1 mm, except for the offset of the first joint."""


@dataclass(frozen=True, kw_only=True)
class HandeyeArgs(HeldBoardArgs):
    """Calibrate the pose of the camera, from pictures of a ChArUco board in the hand of the arm.

    The simulated arm shows the board in poses that are within reach, in view and clear of table and arm; pictures of a
    real camera and arm come from a folder. Six published methods give a first solution each; one robust fit of all
    corners in all pictures finds the poses of camera and board, the scale of the print and the offsets of the joints.
    Every fifth picture is held out of a second fit, which shows how well camera and arm agree where nothing was fitted.

    Try
      dlokit calibrate handeye                              in the simulated cell
      dlokit calibrate handeye --dry-run                    check all motions, move nothing
      dlokit calibrate handeye --from pictures --serial 7F2A --board.square-m 0.0298
      dlokit shape --calibration runs/<time>-calibrate-handeye/calibration.toml

    Writes calibration.toml with date, serial and residuals, and the pictures of the cell, which --from reads again.
    Exit code: 0; 3 when a dry run refuses a motion; 2 when the pictures do not give a calibration, or camera and arm
    contradict each other; 130 after Ctrl-C.
    """

    poses: int = POSES
    """Poses of the simulated arm; at least 10. More: a better result, about 0.3 s each."""
    intrinsics: Annotated[Path | None, flag("FILE", "fitted to the same pictures")] = None
    """Optics of the camera: a calibration.toml of `dlokit calibrate stereo`."""


def run(args: HandeyeArgs) -> int:
    """Take or read the pictures, calibrate, print and write."""
    console = Console()
    if args.dry_run:
        return rehearse_in_hand(args, args.poses, console)
    known = None if args.intrinsics is None else read_calibration(args.intrinsics)
    folder = args.folder_for("calibrate-handeye")
    try:
        seen = seen_in_hand(args, args.poses, console)
        keep_pictures(args, folder, seen)
        if known is not None:
            check_same_camera(str(args.intrinsics), known, seen.given)
            known = msgspec.structs.replace(known, date=today())
        poseless = [picture.name for picture in seen.pictures if picture.T_world_tcp is None]
        if poseless:
            missing = f"{len(poseless)} of {len(seen.pictures)} pictures, {', '.join(poseless)}"
            say(console, f"no line in {POSES_FILE}: {missing}")
        arm = args.installed.arm.model
        found = calibrate_pose(seen.shots, args.board, known or seen.camera, fit_optics=known is None, arm=arm)
    except SkillFailure as failure:
        raise input_error(failure) from failure
    _print(found, seen, args, console)
    write_calibration(folder / CALIBRATION, args.installed.written(found.fit.camera), residual_of(found))
    say(console, f"written: {folder / CALIBRATION}")
    if not found.fit.camera.serial:
        say(console, f"no serial is known: every camera will accept the file; {NO_SERIAL}")
    say(console, _use(folder / CALIBRATION, args))
    return 0


def _use(calibration: Path, args: HandeyeArgs) -> str:
    """How a run uses the result."""
    if args.installation is None:
        return f"use it: dlokit shape --calibration {calibration}"
    name = os.path.relpath(calibration, args.installation.expanduser().absolute().parent)
    return f'use it: write calibration = "{name}" under [camera] in {args.installation}'


def residual_of(found: CalibratedPose) -> CalibrationResidual:
    """Accuracy of a calibration, for its file."""
    apart_m, apart_rad, reported_m = found.apart.worst
    return CalibrationResidual(
        method="hand-eye, robust fit of all corners",
        pictures=len(found.fit.shots),
        rms_px=found.fit.rms_px,
        held_out_m=apart_m,
        held_out_deg=float(np.degrees(apart_rad)),
        corners_m=float(found.corners_m.max()),
        print_scale=found.fit.print_scale,
        reported_m=reported_m,
        joint_offsets_deg=_degrees(found.fit.joint_offsets_rad),
        joint_sigma_deg=_degrees(found.fit.joint_sigma_rad),
    )


def _degrees(angles_rad: Float64Array | None) -> tuple[float, ...] | None:
    return None if angles_rad is None else tuple(np.degrees(angles_rad).tolist())


def _print(found: CalibratedPose, seen: Seen, args: HandeyeArgs, console: Console) -> None:
    fit = found.fit
    methods = Table(title="error of the corners in the pictures")
    methods.add_column("method")
    methods.add_column("RMS, px", justify="right")
    for name, rms_px in fit.rms_by_method_px.items():
        methods.add_row(name, f"{rms_px:.3f}")
    methods.add_row("fit of all corners", f"{fit.rms_px:.3f}", style="bold")
    console.print(methods)
    corners = Table(title="standard deviation at the corners of the workspace")
    for heading in ("x, m", "y, m", "z, m", "mm"):
        corners.add_column(heading, justify="right")
    for place, deviation_m in zip(workspace_corners(), found.corners_m, strict=True):
        corners.add_row(*(f"{value:.2f}" for value in place), f"{deviation_m * 1e3:.2f}")
    console.print(corners)
    omitted = sum(shot.T_world_tcp is not None for shot in seen.shots) - len(fit.shots)
    if omitted:
        say(console, f"omitted because they contradict the rest: {omitted} pictures")
    apart_m, apart_rad, reported_m = found.apart.worst
    say(
        console,
        f"held-out poses ({len(found.apart.position_m)}): camera and arm are {apart_m * 1e3:.2f} mm and "
        f"{np.degrees(apart_rad):.2f}° apart (95th percentile)",
    )
    place = ", ".join(f"{value:.4f}" for value in args.installed.written(fit.camera).T_world_camera.position_m)
    frame = "" if args.installation is None else f" in the frame of {args.installation.name}"
    say(console, f"camera at ({place}) m{frame}; the print is {fit.print_scale:.4f} of its nominal size")
    if fit.joint_offsets_rad is not None and fit.joint_sigma_rad is not None:
        offsets = zip(np.degrees(fit.joint_offsets_rad), np.degrees(fit.joint_sigma_rad), strict=True)
        _print_joints(list(offsets), fit.seen_joints, reported_m, console)


def _print_joints(
    offsets_deg: Sequence[tuple[float, float]], seen: Sequence[int], reported_m: float, console: Console
) -> None:
    """The offsets of the joints with their standard deviations [°], and their effect on a run."""
    joints = Table(title="offsets of the joints, reported minus true")
    for heading in ("joint", "offset, °", "standard deviation, °"):
        joints.add_column(heading, justify="right")
    for index, (offset, sigma) in enumerate(offsets_deg):
        known = index in seen
        joints.add_row(str(index + 1), f"{offset:+.3f}" if known else "not seen", f"{sigma:.3f}" if known else "")
    console.print(joints)
    say(
        console,
        f"with them in its poses, which a run uses, the arm has the board {reported_m * 1e3:.2f} mm from "
        "where the camera sees it (held-out poses, 95th percentile). A run does not correct the arm: if this is more "
        "than your task allows, correct the zero positions in the arm's controller, and calibrate again",
    )


COMMAND = CliCommand(HandeyeArgs, run)
