"""`dlokit export`: export recorded runs for learning, as arrays, tables or a data set."""

import csv
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console

from dlokit.app.commands import CliCommand
from dlokit.app.data.lerobot import write_lerobot
from dlokit.errors import InputError
from dlokit.recording.channels import FILE_NAME, PICTURE_ROWS, RECORDED, topic_of
from dlokit.recording.columns import Column, columns
from dlokit.recording.reader import RawRecording, Recorded, picture_file, read_recording
from dlokit.system.results.run_folder import claim_run_folder

MOST_COLUMNS = 512
"""Fields with more numbers per message are omitted from `.csv` files: covariances and depth."""
PICTURES = {"view/left": "left", "view/right": "right", "view/colour": "colour", "view/depth": "depth"}


def write_npz(path: Path, folder: Path) -> list[str]:
    """Write `<topic>.npz` for each topic, and the pictures; returns the omitted fields, which are none."""
    for name, found in _tables(path):
        arrays: dict[str, NDArray[Any]] = {}
        for column in found:
            arrays[column.name] = column.values
            if column.first is not None:
                arrays[f"{column.name}.first"] = column.first
        np.savez_compressed(folder / f"{name}.npz", **arrays)  # type: ignore[arg-type]
    _write_pictures(path, folder)
    return []


def write_csv(path: Path, folder: Path) -> list[str]:
    """Write `<topic>.csv` for each topic, and the pictures; returns the omitted fields, which are too long for a
    line."""
    left_out: list[str] = []
    for name, found in _tables(path):
        kept = [column for column in found if column.first is None and _width(column) <= MOST_COLUMNS]
        left_out += [f"{name}.{column.name}" for column in found if column not in kept]
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([heading for column in kept for heading in _headings(column)])
            writer.writerows(_lines(kept))
    _write_pictures(path, folder)
    return left_out


def _tables(path: Path) -> Iterable[tuple[str, list[Column]]]:
    by_topic: defaultdict[str, list[Recorded]] = defaultdict(list)
    for one in read_recording(path, _WithoutPictures()):
        by_topic[one.topic].append(one)
    for topic, messages in by_topic.items():
        yield topic.replace("/", "_"), columns(messages)


class _WithoutPictures:
    """The topics without pictures; pictures are written as separate files."""

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in RECORDED and topic.row not in PICTURE_ROWS


def _width(column: Column) -> int:
    return int(np.prod(column.values.shape[1:]))


def _headings(column: Column) -> list[str]:
    shape = column.values.shape[1:]
    if not shape:
        return [column.name]
    return ["_".join((column.name, *map(str, index))) for index in np.ndindex(*shape)]


def _lines(kept: list[Column]) -> Iterable[list[Any]]:
    for number in range(len(kept[0].values)):
        yield [value for column in kept for value in np.ravel(column.values[number]).tolist()]


def _write_pictures(path: Path, folder: Path) -> None:
    for channel, record in RawRecording(path=path):
        if channel in PICTURES:
            picture = picture_file(record.data)
            side = folder / "pictures" / PICTURES[channel]
            side.mkdir(parents=True, exist_ok=True)
            (side / f"{record.publish_time:020d}.{picture.format}").write_bytes(picture.data)


MOST_NAMED = 8

Form = Literal["npz", "csv", "lerobot"]


@dataclass(frozen=True, kw_only=True)
class ExportArgs:
    """Export recorded runs as data sets for learning: states, targets, goals, robot, actions, calls, pictures.

    Try
      dlokit export runs/<run> --to npz --out data              one file per topic, for numpy.load
      dlokit export runs/<run> --to csv --out data              the same as tables
      dlokit export runs/* --to lerobot --out data --fps 10     a LeRobot data set (v2.1), one episode per run

    Pictures are written as recorded: JPEG, depths as PNG of 16 bits in millimetres, which a LeRobot data set omits.
    `--to lerobot` needs pyarrow: pip install 'dlokit[export]'.
    Exit code: 0 written; 2 bad input.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The recording.mcap of one or more runs, or the folders of the runs."""
    to: Form
    """npz: arrays, one file per topic. csv: tables, one file per topic, without clouds and covariances. lerobot: frames
    at a constant rate, for imitation learning."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder; it must be empty or not exist yet."""
    fps: int = 10
    """Frames per second of the run's clock, for lerobot."""
    images: bool = True
    """Include the pictures in the frames, for lerobot."""


def run(args: ExportArgs) -> int:
    """Read, convert and write the recordings, and print what was written."""
    if not args.files:
        raise InputError("no recording is given; give one or more, e.g. dlokit export runs/<run> --to npz --out data.")
    if not 1 <= args.fps <= 100:
        raise InputError(f"--fps is {args.fps}; it must be 1 to 100 frames per second.")
    paths = [file / FILE_NAME if file.is_dir() else file for file in args.files]
    out = claim_run_folder(args.out)
    console = Console()

    def say(text: str) -> None:
        console.print(text, highlight=False, markup=False, soft_wrap=True)

    if args.to == "lerobot":
        frames = write_lerobot(paths, out, args.fps, images=args.images)
        say(f"{out}: {len(paths)} episodes, {frames} frames at {args.fps} per second")
        return 0
    for number, path in enumerate(paths):
        folder = out if len(paths) == 1 else out / f"{number:03d}"
        folder.mkdir(exist_ok=True)
        left_out = write_npz(path, folder) if args.to == "npz" else write_csv(path, folder)
        say(f"{folder}: {sum(1 for file in folder.rglob('*') if file.is_file())} files of {path}")
        if left_out:
            named = ", ".join(left_out[:MOST_NAMED]) + (", …" if len(left_out) > MOST_NAMED else "")
            say(f"not in the tables, because they are too long for a line (--to npz includes them): {named}")
    return 0


COMMAND = CliCommand(ExportArgs, run)
