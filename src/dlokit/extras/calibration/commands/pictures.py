"""`dlokit calibrate pictures`: pictures of a board by a camera that need not be calibrated yet."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag, value_of
from dlokit.app.console import say
from dlokit.communication.memory import MemoryTransport
from dlokit.description.board import CharucoBoard
from dlokit.errors import EXIT_INTERRUPTED, EXIT_OTHERWISE, HardwareError, InputError, NoMorePictures
from dlokit.extras.calibration.charuco import BoardView, find_board
from dlokit.extras.calibration.commands.folder import CALIBRATION, write_picture
from dlokit.extras.calibration.procedure import FEWEST_SHOTS
from dlokit.functional.cameras.base import Camera, UncalibratedConfig
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cameras.strategies import CAMERAS, AnyCamera
from dlokit.system.results.run_folder import run_folder
from dlokit.types.image import CameraPictures, StereoImages

USUAL = "genicam"
"""The default camera: the only kind that needs a calibration before use."""
_TIMEOUT_S = 2.0
AGAIN_S = 1.0
"""Time between two attempts to reach a lost camera [s]."""
_STILL_PX = 1.0
"""Largest motion of a corner between two pictures of a still board [px]: faster motion blurs the corners."""
_MOVED_PX = 25.0
"""Least motion of a corner since the last saved picture [px]: the same view twice adds no information."""
_FIELDS = 3
"""Rows and columns of fields of the picture; a calibration needs corners in all of them."""


@dataclass(frozen=True, kw_only=True)
class PicturesArgs:
    """Take pictures of a ChArUco board with a camera that is not calibrated yet, for the other calibrations.

    Show the board to the camera and hold it still: a picture is saved as soon as the board rests, and the next one when
    it was moved and rests again. Fill all parts of the picture, near and far, with the board tilted to all sides. The
    terminal says which parts are still empty. Ctrl-C ends earlier and keeps what was saved.

    Try
      dlokit calibrate pictures --camera genicam --camera.left GV01 --camera.right GV02
      dlokit calibrate stereo --from runs/<time>-calibrate-pictures --board.square-m 0.0398

    Writes left_NAME.png, right_NAME.png of a pair, and the serial of the camera.
    Exit code: 0; 130 after Ctrl-C; 2 for a camera that is not there; 3 a recording ended with fewer pictures.
    """

    camera: Annotated[str, tyro.conf.arg(constructor_factory=CAMERAS.names)] = USUAL
    """The camera: genicam, realsense, recorded, or another installed one."""
    count: int = 50
    """Pictures to save; at least 10. More: a better calibration."""
    board: CharucoBoard = field(default_factory=CharucoBoard)
    """The printed board; here only the number of its squares and its markers matter."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-calibrate-pictures/")] = None
    """Folder for the pictures; it must be empty or new."""
    camera_settings: Annotated[AnyCamera, tyro.conf.arg(name="camera")] = field(
        default_factory=lambda: CAMERAS.named(USUAL, "--camera")()
    )
    """Settings of the camera; `genicam` needs no calibration here."""

    def __post_init__(self) -> None:
        if self.count < FEWEST_SHOTS:
            raise InputError(f"--count is {self.count}; it must be {FEWEST_SHOTS} or greater.")
        if self.camera_settings.sees_cell:
            raise InputError(
                f"--camera {self.camera} sees the simulated cell, whose pictures `dlokit calibrate stereo` and "
                "`handeye` take themselves: choose genicam, realsense, recorded or an installed camera."
            )


def _defaults(arguments: Sequence[str]) -> PicturesArgs:
    """The settings of the camera that the command line names."""
    name = value_of(arguments, "--camera")
    return PicturesArgs() if name is None else PicturesArgs(camera_settings=CAMERAS.named(name, "--camera")())


def run(args: PicturesArgs) -> int:
    """Take pictures until there are enough."""
    return take_pictures(args, uncalibrated(args.camera_settings))


def take_pictures(args: PicturesArgs, camera: Camera, again_s: float = AGAIN_S) -> int:
    """Take pictures with `camera` until there are enough; a lost camera is tried again after `again_s` [s]."""
    console = Console()
    with camera:
        folder = run_folder(args.out, "calibrate-pictures")
        taking = Taking(args.board, folder, args.count, console)
        say(console, f"show the board, and hold it still; {args.count} pictures go to {folder}; Ctrl-C ends earlier")
        code = 0
        try:
            asyncio.run(taking.follow(camera, again_s))
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
        if taking.saved:
            # Its serial and size, for the file of the calibration.
            write_calibration(folder / CALIBRATION, camera.calibration)
    taking.say_end()
    return code if taking.saved >= args.count else code or EXIT_OTHERWISE


def uncalibrated(settings: AnyCamera) -> Camera:
    """The camera, with estimated optics if it has none. Raises `ConfigError`, `HardwareError`."""
    if isinstance(settings, UncalibratedConfig) and not settings.calibration:
        return settings.uncalibrated()
    return settings.build(MemoryTransport())


class Taking:
    """Saves useful pictures, and prints the parts of the picture that are still empty."""

    def __init__(self, board: CharucoBoard, folder: Path, count: int, console: Console) -> None:
        self._board, self._folder, self._count, self._console = board, folder, count, console
        self._before: BoardView | None = None
        self._saved: BoardView | None = None
        self._filled = np.zeros((_FIELDS, _FIELDS), dtype=bool)  # rows from the top, columns from the left
        self._seen: bool | None = None
        self.saved = 0
        """Number of pictures in the folder."""

    async def follow(self, camera: Camera, again_s: float) -> None:
        """Take pictures until there are enough, or a recording ends; a lost camera is named and waited for."""
        while self.saved < self._count:
            try:
                pictures = await camera.capture(_TIMEOUT_S)
            except NoMorePictures as end:
                say(self._console, str(end))
                return
            except HardwareError as error:
                say(self._console, f"the camera is lost: {error}")
                await asyncio.sleep(again_s)
                continue
            await asyncio.to_thread(self.take, pictures)

    def take(self, pictures: CameraPictures) -> bool:
        """Save pictures that show the board at rest at a new place; return whether they were saved."""
        left, right = pictures.reference, pictures.right if isinstance(pictures, StereoImages) else None
        view = find_board(left, self._board)
        if right is not None and view is not None and find_board(right, self._board) is None:
            view = None
        before, self._before = self._before, view
        self._say_seen(view is not None, pair=right is not None)
        if view is None or moved_px(before, view) > _STILL_PX or moved_px(self._saved, view) < _MOVED_PX:
            return False
        for side, pixels in (("left", left), ("right", right)):
            if pixels is not None:
                write_picture(self._folder / f"{side}_{self.saved:03d}.png", pixels)
        self._saved = view
        self.saved += 1
        height, width = left.shape[:2]
        fields = np.floor(_FIELDS * view.pixels / (width, height)).astype(int).clip(0, _FIELDS - 1)
        self._filled[fields[:, 1], fields[:, 0]] = True
        say(self._console, f"{self.saved} of {self._count}: {len(view.numbers)} corners; {self._empty()}")
        return True

    def say_end(self) -> None:
        """Print the number of saved pictures and the next command."""
        say(self._console, f"{self.saved} of {self._count} pictures in {self._folder}; {self._empty()}")
        if self.saved:
            say(self._console, f"next: dlokit calibrate stereo --from {self._folder}")

    def _say_seen(self, seen: bool, *, pair: bool) -> None:
        if seen != self._seen:
            self._seen = seen
            where = "in both pictures" if pair else "in the picture"
            say(self._console, f"the board is {where}" if seen else f"the board is not {where}")

    def _empty(self) -> str:
        rows, columns = ("top", "middle", "bottom"), ("left", "centre", "right")
        empty = [f"{rows[row]} {columns[column]}" for row, column in np.argwhere(~self._filled).tolist()]
        return f"no corner yet {', '.join(empty)}" if empty else "all parts of the picture are filled"


def moved_px(before: BoardView | None, now: BoardView) -> float:
    """Largest motion of a corner that both views show [px]; infinite without a common corner."""
    if before is None:
        return float("inf")
    _, a, b = np.intersect1d(before.numbers, now.numbers, return_indices=True)
    return float(np.linalg.norm(now.pixels[b] - before.pixels[a], axis=1).max()) if len(a) else float("inf")


COMMAND = CliCommand(PicturesArgs, run, _defaults)
