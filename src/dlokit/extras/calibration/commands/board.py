"""`dlokit calibrate board`: the pattern to print."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand
from dlokit.app.console import say
from dlokit.description.board import CharucoBoard
from dlokit.errors import InputError
from dlokit.extras.calibration.commands.folder import write_picture

_PX_PER_M = 300 / 0.0254  # 300 dots per inch


@dataclass(frozen=True, kw_only=True)
class PrintArgs:
    """Write the picture of a ChArUco board to print.

    Print it without scaling (300 dots per inch), glue it to a flat plate, and measure a row of squares: the
    printed size of a square is `--board.square-m` of the other commands.

    Try
      dlokit calibrate board --out board.png
      dlokit calibrate board --out small.png --board.square-m 0.02 --board.marker-m 0.015
    """

    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("board.png")
    """Picture file; an existing one is not overwritten."""
    board: CharucoBoard = field(default_factory=CharucoBoard)
    """The board."""


def run(args: PrintArgs) -> int:
    """Write the picture."""
    if args.out.exists() or args.out.suffix != ".png" or not args.out.absolute().parent.is_dir():
        raise InputError(f"--out {args.out}: name a new .png file in a folder that exists.")
    square_px = round(args.board.square_m * _PX_PER_M)
    write_picture(args.out, args.board.picture(square_px))
    width_m, height_m = args.board.size_m
    say(Console(), f"written: {args.out}; print it {width_m * 1e3:.0f} mm wide and {height_m * 1e3:.0f} mm high")
    return 0


COMMAND = CliCommand(PrintArgs, run)
