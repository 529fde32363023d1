"""`dlokit calibrate latency`: the latency of a camera's stamps, from a board in the hand of a moving arm."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
from rich.console import Console

from dlokit import geometry
from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.cell_pictures import PicturesInMotion, late, pictures_in_motion
from dlokit.extras.calibration.charuco import find_board
from dlokit.extras.calibration.commands.common import (
    HeldBoardArgs,
    done_in_cell,
    given_calibration,
    input_error,
    rehearse,
    shown_poses,
    today,
)
from dlokit.extras.calibration.commands.folder import (
    CALIBRATION,
    RecordedMotion,
    camera_of_folder,
    read_motion,
    write_motion,
)
from dlokit.extras.calibration.latency import LatencyFit, StampedView, ToolTrack, fit_latency
from dlokit.functional.cameras.calibration_file import (
    CalibrationResidual,
    MeasuredLatency,
    MeasuredTable,
    check_same_camera,
    read_part,
    write_calibration,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

_POSES = 4
"""Poses that the simulated arm moves through, there and back, twice: 12 moves, about 95 pictures."""


@dataclass(frozen=True, kw_only=True)
class LatencyArgs(HeldBoardArgs):
    """Measure the latency of a camera's stamps with a ChArUco board in the hand of the moving arm.

    The arm moves back and forth while the camera takes pictures. At the correct offset, the board in the pictures
    agrees with the hand in the states of the arm. The board's numbered corners give position and rotation of the hand
    in each picture to a tenth of a millimetre; an outline of the hand would be blurred and partly hidden. In the
    simulated cell the stamps are late by 80 ms and the camera's clock is fast by 50 ppm.

    Try
      dlokit calibrate latency                                 in the simulated cell
      dlokit calibrate latency --from moving --calibration calibration.toml
      dlokit shape --cell.camera-late-s 0.08 --calibration runs/<time>-calibrate-latency/calibration.toml

    Writes calibration.toml, the same calibration with the offset, which a run subtracts from the stamps; and the
    pictures, stamps and states of the cell, which --from reads again.
    Exit code: 0; 3 when a dry run refuses a motion; 2 when the pictures do not give an offset to 5 ms; 130 after
    Ctrl-C.
    """

    calibration: Annotated[Path | None, flag("FILE", "the simulated camera's own")] = None
    """Calibration of the camera with its pose, of `dlokit calibrate handeye`."""


def run(args: LatencyArgs) -> int:
    """Take or read the pictures, fit, print and write."""
    console = Console()
    known = given_calibration(args, args.calibration)
    if args.dry_run:
        plan = partial(_there_and_back, args=args)
        return rehearse(late(args.cell(held=True)), plan, 4 * (_POSES - 1) + 1, console, pause_s=0.0)
    folder = args.folder_for("calibrate-latency")
    motion, given = _recorded(args, args.from_) if args.from_ is not None else _in_cell(args, console)
    if args.from_ is None:
        write_motion(folder, _moved(motion, args.installed.world_to_base), given)
    if known is not None:
        check_same_camera(str(args.calibration), known, given)
    camera = given if known is None else args.installed.read(known)
    views = [
        StampedView(view=view, stamp_ns=stamp_ns)
        for picture, stamp_ns in zip(motion.pictures, motion.stamps_ns, strict=True)
        if (view := find_board(picture, args.board)) is not None
    ]
    say(console, f"{len(views)} of {len(motion.pictures)} pictures show the board")
    try:
        fit = fit_latency(views, motion.track, args.board, camera)
    except SkillFailure as failure:
        raise input_error(failure) from failure
    _print(fit, console)
    _write(folder / CALIBRATION, args.installed.written(camera), fit, args.calibration)
    say(console, f"written: {folder / CALIBRATION}")
    return 0


def _recorded(args: LatencyArgs, folder: Path) -> tuple[RecordedMotion, CameraCalibration]:
    motion = _moved(read_motion(folder), args.installed.base_to_world)
    return motion, camera_of_folder(folder, motion.pictures[0], args.serial, today())


def _moved(motion: RecordedMotion, frame: Callable[[Pose], Pose]) -> RecordedMotion:
    """The motion with the poses of the arm in another frame."""
    track = motion.track
    poses = [frame(geometry.pose(*one)) for one in zip(track.position_m, track.wxyz, strict=True)]
    return replace(motion, track=ToolTrack.of(track.stamps_ns, poses))


def _there_and_back(camera: CameraCalibration, args: LatencyArgs) -> Sequence[Float64Array]:
    there = shown_poses(camera, _POSES, args)
    back = there[-2::-1]
    # In backward motion an offset of the stamps shifts the pictures to the other side; an error of the poses does not.
    return (*there, *back, *there[1:], *back)


def _in_cell(args: LatencyArgs, console: Console) -> tuple[RecordedMotion, CameraCalibration]:
    with done_in_cell(console, "moves", 4 * (_POSES - 1)) as note:
        taken = pictures_in_motion(late(args.cell(held=True)), partial(_there_and_back, args=args), note)
    return _motion_of(taken), taken.images[0].calibration


def _motion_of(taken: PicturesInMotion) -> RecordedMotion:
    return RecordedMotion(
        pictures=[images.reference for images in taken.images],
        stamps_ns=[images.stamp_ns for images in taken.images],
        track=ToolTrack.of([state.stamp_ns for state in taken.states], [state.T_world_tcp for state in taken.states]),
    )


def _print(fit: LatencyFit, console: Console) -> None:
    say(
        console,
        f"the stamps are {abs(fit.late_s) * 1e3:.1f} ms {'late' if fit.late_s >= 0.0 else 'early'}, to "
        f"{fit.uncertainty_s * 1e3:.1f} ms (95 %), by {fit.pictures} pictures; corners are {fit.rms_px:.2f} px off, "
        f"without the correction {fit.uncorrected_rms_px:.2f} px",
    )


def _write(file: Path, camera: CameraCalibration, fit: LatencyFit, known: Path | None) -> None:
    write_calibration(
        file,
        msgspec.structs.replace(camera, stamps_late_s=fit.late_s),
        read_part(known, CalibrationResidual),
        read_part(known, MeasuredTable),
        MeasuredLatency(
            date=today(),
            pictures=fit.pictures,
            uncertainty_s=fit.uncertainty_s,
            rms_px=fit.rms_px,
            uncorrected_rms_px=fit.uncorrected_rms_px,
        ),
    )


COMMAND = CliCommand(LatencyArgs, run)
