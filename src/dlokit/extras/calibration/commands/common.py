"""Common parts of the commands of `dlokit calibrate`: pictures, folder of results, progress."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console

from dlokit.app.commands import flag
from dlokit.app.console import progress_bar, say
from dlokit.description.board import CharucoBoard
from dlokit.errors import EXIT_OTHERWISE, InputError, SkillFailure
from dlokit.extras.calibration.board_poses import HeldBoard, board_poses
from dlokit.extras.calibration.cell_pictures import (
    REST_S,
    BoardPicture,
    Plan,
    Progress,
    cell_config,
    checked_poses,
    pictures_of_board_on_table,
    pictures_of_held_board,
    without_optics,
)
from dlokit.extras.calibration.commands.folder import camera_of_folder, read_pictures, write_pictures
from dlokit.extras.calibration.commands.installed import CalibratedInstallation
from dlokit.extras.calibration.procedure import FEWEST_SHOTS, TakenPicture, find_shots
from dlokit.extras.calibration.stereo_rig import BoardShot
from dlokit.functional.cameras.calibration_file import check_has_pose, read_calibration
from dlokit.functional.cameras.simulated import SimulatedStereoConfig
from dlokit.functional.cell.board import BOARD, T_TCP_BOARD
from dlokit.functional.cell.rendering import check_opengl
from dlokit.system.config import RunConfig
from dlokit.system.results.run_folder import run_folder
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration, StereoImages
from dlokit.types.pose import Pose

NO_SERIAL = "give --serial, unless the camera reports none (dlokit doctor lists it)"
"""Advice where no serial is known: a run refuses a file with a serial for a camera that reports none."""
_ON_TABLE = 5  # pictures of a board that lies still


def _from_flag() -> Any:
    return tyro.conf.arg(name="from", metavar="DIR", help_behavior_hint="(default: the simulated cell)")


@dataclass(frozen=True, kw_only=True)
class BoardArgs:
    """Source of the board's pictures, and folder of the results."""

    from_: Annotated[Path | None, _from_flag()] = None
    """Folder with recorded pictures left_NAME.png (and right_NAME.png) of the board, and the arm's poses in poses.csv.
    Without it the simulated arm shows the board to the simulated camera."""
    board: CharucoBoard = field(default_factory=CharucoBoard)
    """The printed board; measure a row of squares and divide."""
    serial: str = ""
    """Serial number of the camera of --from; a run with the calibration refuses every other camera."""
    seed: int = 0
    """Seed of the simulated cell: noise, errors of print and joints, poses of the arm."""
    lens_distortion: bool = False
    """Calibrate the simulated camera with distorting lenses; a run uses the result with `--cell.lens-distortion`."""
    installation: Annotated[Path | None, flag("FILE", "the default cell")] = None
    """Installation file. The simulated cell is set up accordingly, with the camera of the file if that is a simulated
    one; poses.csv of --from is in the base of its first arm. The camera's pose in the result is in the frame of this
    file, which may then name the result."""
    separate_cameras: bool = False
    """Calibrate two simulated cameras on a bracket that are not parallel; as `--cell.separate-cameras` of a run."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-calibrate-<name>/")] = None
    """Folder for calibration.toml and, from the cell, the pictures; it must be empty or new."""

    @cached_property
    def installed(self) -> CalibratedInstallation:
        """The installation. Raises `ConfigError`, which names file and key."""
        return CalibratedInstallation(self.installation)

    def folder_for(self, name: str) -> Path:
        """The folder of the results. Raises `InputError` where the cell should take the pictures and cannot."""
        if self.from_ is None:
            self._check_camera()
        return run_folder(self.out, name)

    def _check_camera(self) -> None:
        camera = self.installed.camera
        if not camera.sees_cell:
            raise InputError(
                f"the camera of {self.installation} is {camera.name}, which does not see the simulated cell: take "
                "pictures of the board with it, and give their folder as --from DIR."
            )
        if (self.lens_distortion or self.separate_cameras) and not isinstance(camera, SimulatedStereoConfig):
            raise InputError(
                f"--lens-distortion and --separate-cameras describe the simulated stereo camera, and the camera of "
                f"{self.installation} is {camera.name}: omit them."
            )

    def cell(self, *, held: bool) -> RunConfig:
        """The simulated cell with the board in the hand of the arm, or on the table.

        Raises `InputError` where the cell has no camera as the installation's.
        """
        self._check_camera()
        cell = cell_config(
            self.seed, held=held, lens_distortion=self.lens_distortion, separate_cameras=self.separate_cameras
        )
        return self.installed.cell(cell)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"--seed is {self.seed}; it must be 0 or greater.")
        if self.from_ is None and (self.board != BOARD or self.serial):
            raise InputError(
                "the simulated cell has a board and a serial of its own; --board and --serial describe the pictures "
                "of --from DIR."
            )


@dataclass(frozen=True, kw_only=True)
class HeldBoardArgs(BoardArgs):
    """As `BoardArgs`, for a board in the hand of a moving arm."""

    dry_run: bool = False
    """Plan the poses, check the motions with an arm in software, and print their duration; no arm moves, and nothing is
    written."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dry_run and self.from_ is not None:
            raise InputError("--from reads pictures and moves no arm: omit --dry-run.")


def shown_poses(camera: CameraCalibration, poses: int, args: BoardArgs) -> Sequence[Float64Array]:
    """Joint angles (J,) [rad] of poses in which the arm shows its board to the camera."""
    arm = args.installed.arm
    fixtures = args.installed.installation.fixtures
    held = HeldBoard(
        board=BOARD, T_tcp_board=T_TCP_BOARD, arm=arm.model, T_world_base=arm.T_world_base, fixtures=fixtures
    )
    return board_poses(held, camera, poses, np.random.default_rng(args.seed))


def rehearse(config: RunConfig, plan: Plan, poses: int, console: Console, pause_s: float = REST_S) -> int:
    """Check the motions of a calibration without moving an arm, and print the result; returns the exit code."""
    with done_in_cell(console, "poses", poses) as note:
        checked = checked_poses(config, plan, note, pause_s)
    for line in checked.refused:
        say(console, line)
    passed = checked.poses - len(checked.refused)
    say(
        console,
        f"dry run: {passed} of {checked.poses} motions pass all checks; the arm needs {checked.duration_s:.0f} s for "
        "them, without pictures and fit. No arm has moved, and nothing is written.",
    )
    return EXIT_OTHERWISE if checked.refused else 0


def config_in_hand(args: BoardArgs, poses: int) -> RunConfig:
    """The cell with the board in the hand. Raises `InputError` for too few poses."""
    if poses < FEWEST_SHOTS:
        raise InputError(f"--poses is {poses}; it must be {FEWEST_SHOTS} or greater.")
    return args.cell(held=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """The pictures of a calibration."""

    pictures: Sequence[TakenPicture]
    shots: Sequence[BoardShot]
    camera: CameraCalibration
    """The camera before the calibration; its date is today."""
    given: CameraCalibration
    """The description of the camera, from itself or from the folder."""


def seen_in_hand(args: BoardArgs, poses: int, console: Console) -> Seen:
    """Pictures of a board in the hand: recorded ones, or of the cell with `poses` poses."""
    if args.from_ is not None:
        return _from_folder(args, args.from_, console)
    config = config_in_hand(args, poses)

    def plan(camera: CameraCalibration) -> Sequence[Float64Array]:
        return shown_poses(camera, poses, args)

    with done_in_cell(console, "poses", poses) as note:
        taken = pictures_of_held_board(config, plan, note)
    return _from_cell(taken, console)


def rehearse_in_hand(args: BoardArgs, poses: int, console: Console) -> int:
    """The dry run of `seen_in_hand`; returns the exit code."""
    return rehearse(config_in_hand(args, poses), lambda camera: shown_poses(camera, poses, args), poses, console)


def seen_on_table(args: BoardArgs, console: Console) -> Seen:
    """Pictures of a board on the table."""
    if args.from_ is not None:
        return _from_folder(args, args.from_, console)
    config = args.cell(held=False)
    with done_in_cell(console, "pictures", _ON_TABLE) as note:
        taken = pictures_of_board_on_table(config, _ON_TABLE, note)
    return _from_cell(taken, console)


def keep_pictures(args: BoardArgs, folder: Path, seen: Seen) -> None:
    """Keep the pictures of the cell, so that `--from` can read them."""
    if args.from_ is None:
        write_pictures(folder, _moved(seen.pictures, args.installed.world_to_base))


def given_calibration(args: BoardArgs, file: Path | None) -> CameraCalibration | None:
    """The calibration of `--calibration`, which has the camera's pose. Raises `InputError` if it is required."""
    if file is None:
        if args.from_ is not None:
            raise InputError("--from needs --calibration FILE, the calibration of the camera that took the pictures.")
        return None
    known = read_calibration(file)
    check_has_pose(str(file), known)
    return known


def today() -> str:
    """The date of a calibration, ISO 8601."""
    return date.today().isoformat()


def input_error(failure: SkillFailure) -> InputError:
    """The message for pictures that give no calibration."""
    return InputError(f"no calibration from these pictures: {failure}")


def _from_folder(args: BoardArgs, folder: Path, console: Console) -> Seen:
    pictures = _moved(read_pictures(folder), args.installed.base_to_world)
    given = camera_of_folder(folder, pictures[0].left, args.serial, today())
    if args.serial and given.serial and args.serial != given.serial:
        raise InputError(
            f"--serial is {args.serial!r}, and {folder} has a calibration of the camera {given.serial!r}: omit "
            "--serial, or use the folder of that camera."
        )
    return _seen(pictures, args.board, given, console)


def _from_cell(taken: Sequence[BoardPicture], console: Console) -> Seen:
    pictures = [
        TakenPicture(
            left=one.images.reference,
            right=one.images.right if isinstance(one.images, StereoImages) else None,
            T_world_tcp=None if one.robot is None else one.robot.T_world_tcp,
            q_rad=None if one.robot is None else one.robot.q_rad,
        )
        for one in taken
    ]
    return _seen(pictures, BOARD, taken[0].images.calibration, console)


def _moved(pictures: Sequence[TakenPicture], frame: Callable[[Pose], Pose]) -> list[TakenPicture]:
    """The pictures with the poses of the arm in another frame."""
    return [one if one.T_world_tcp is None else replace(one, T_world_tcp=frame(one.T_world_tcp)) for one in pictures]


def _seen(pictures: list[TakenPicture], board: CharucoBoard, given: CameraCalibration, console: Console) -> Seen:
    shots = find_shots(pictures, board)
    say(console, f"{len(shots)} of {len(pictures)} pictures show the board")
    return Seen(pictures=pictures, shots=shots, camera=without_optics(given, today()), given=given)


@contextmanager
def done_in_cell(console: Console, what: str, total: int) -> Generator[Progress]:
    """A progress bar for the cell; yields the function that advances it. Raises `MachineError` without OpenGL."""
    check_opengl()
    say(console, f"in the simulated cell: {total} {what} of the board; Ctrl-C stops")
    with progress_bar(console) as progress:
        bar = progress.add_task(what, total=total)
        yield lambda number, _: progress.update(bar, completed=number)
