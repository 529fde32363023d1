"""`dlokit export`: recorded runs for people who learn from them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from dlokit.app.command import Command
from dlokit.app.export_lerobot import write_lerobot
from dlokit.app.export_tables import write_csv, write_npz
from dlokit.errors import InputError
from dlokit.recording.channels import FILE_NAME
from dlokit.system.run_folder import claim_run_folder

MOST_NAMED = 8

Form = Literal["npz", "csv", "lerobot"]


@dataclass(frozen=True, kw_only=True)
class ExportArgs:
    """Hand recorded runs to people who learn from them: states, targets, goals, robot, actions, calls, pictures.

    Try
      dlokit export runs/<run> --to npz --out data              a file a topic, for numpy.load
      dlokit export runs/<run> --to csv --out data              the same as tables
      dlokit export runs/* --to lerobot --out data --fps 10     a LeRobot dataset (v2.1), an episode a run

    Pictures are written as they were recorded (JPEG). `--to lerobot` needs pyarrow: pip install 'dlokit[export]'.
    Exit code: 0; 2 bad input.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The recording.mcap of one or more runs, or the runs' folders."""
    to: Form
    """npz: arrays, a file a topic. csv: tables, a file a topic; clouds and covariances do not fit. lerobot: frames at a
    steady rate, for imitation learning."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for what is written; must be empty or not exist yet."""
    fps: int = 10
    """Frames a second of the run's clock, for lerobot."""
    images: bool = True
    """Whether pictures are a part of the frames, for lerobot."""


def run(args: ExportArgs) -> int:
    """Read, convert, write, and say what was written."""
    if not args.files:
        raise InputError("no recording is named; give one or more, e.g. dlokit export runs/<run> --to npz --out data.")
    if not 1 <= args.fps <= 100:
        raise InputError(f"--fps is {args.fps}; it must be 1 to 100 frames a second.")
    paths = [file / FILE_NAME if file.is_dir() else file for file in args.files]
    out = claim_run_folder(args.out)
    console = Console()

    def say(text: str) -> None:
        console.print(text, highlight=False, markup=False, soft_wrap=True)

    if args.to == "lerobot":
        frames = write_lerobot(paths, out, args.fps, images=args.images)
        say(f"{out}: {len(paths)} episodes, {frames} frames at {args.fps} a second")
        return 0
    for number, path in enumerate(paths):
        folder = out if len(paths) == 1 else out / f"{number:03d}"
        folder.mkdir(exist_ok=True)
        left_out = write_npz(path, folder) if args.to == "npz" else write_csv(path, folder)
        say(f"{folder}: {sum(1 for file in folder.rglob('*') if file.is_file())} files of {path}")
        if left_out:
            named = ", ".join(left_out[:MOST_NAMED]) + (", …" if len(left_out) > MOST_NAMED else "")
            say(f"not in the tables, as they are too long for a line (--to npz has them): {named}")
    return 0


COMMAND = Command(ExportArgs, run)
