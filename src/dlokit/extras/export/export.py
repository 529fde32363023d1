"""`dlokit export`: export recorded runs as arrays, tables or a data set for learning, or as videos for people."""

import csv
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import progress_bar, say
from dlokit.errors import EXIT_OTHERWISE, InputError, require_cell
from dlokit.extras.export.columns import Column, columns
from dlokit.recording.channels import FILE_NAME, PICTURE_ROWS, ChannelsOf, recorded_topics
from dlokit.recording.export_format import ExportFormat, added_formats
from dlokit.recording.reader import RawRecording, Recorded, missing_part, picture_file, read_recording
from dlokit.system.results.run_folder import CLAIM, claim_run_folder, release_claim

MOST_COLUMNS = 512
"""Fields with more numbers per message are omitted from `.csv` files: covariances and depth."""
PICTURES = {"view/left": "left", "view/right": "right", "view/colour": "colour", "view/depth": "depth"}


def write_npz(path: Path, folder: Path) -> list[str]:
    """Write `<topic>.npz` for each topic, and the pictures; returns the omitted fields, always empty."""
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
    """Write `<topic>.csv` for each topic, and the pictures; returns the omitted fields, too long for a line."""
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
    # Pictures are written as separate files.
    for one in read_recording(path, ChannelsOf(row for row in recorded_topics() if row not in PICTURE_ROWS)):
        by_topic[one.topic].append(one)
    for topic, messages in by_topic.items():
        yield topic.replace("/", "_"), columns(messages)


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

Form = Literal["npz", "csv", "lerobot", "mp4"]
"""dlokit's own formats; packages add theirs by entry points `dlokit.exports`."""
OWN: tuple[str, ...] = get_args(Form)
FORMS = (
    "npz: arrays, one file per topic. csv: tables, one file per topic, without clouds and covariances. lerobot: frames "
    "at a constant rate and videos, for imitation learning. mp4: a video of each run, for people."
)
LEROBOT_FPS, VIDEO_FPS = 10, 25
VIDEO_NAME = "run.mp4"


def form_names() -> Any:
    """The literal type of all formats, for the command line."""
    return Literal[(*OWN, *added_formats(OWN))]


def forms() -> str:
    """The formats, for ``--help``."""
    return " ".join((FORMS, *(f"{form.name}: {form.doc}." for form in added_formats(OWN).values())))


@dataclass(frozen=True, kw_only=True)
class ExportArgs:
    """Export recorded runs as data sets for learning, with all messages or a picture for each frame, or as videos.

    Try
      dlokit export runs/<run> --to mp4                         a video of the run, in its folder
      dlokit export runs/* --to lerobot --out data --fps 10     a LeRobot data set (v3.0), one episode per run
      dlokit export runs/<run> --to npz --out data              one file per topic, for numpy.load
      dlokit export runs/<run> --to csv --out data              the same as tables

    npz and csv get the pictures as recorded: JPEG, depths as PNG of 16 bits in millimetres. lerobot and mp4 get a
    picture for each frame, rendered again, where the run was simulated and its folder has truth.npz; else the recorded
    ones.
    `--to lerobot` needs pyarrow, of the extra `export`.
    Exit code: 0 written; 2 bad input, nothing is written; 3 written, but a recording is truncated or damaged, and the
    rest of it was exported; 130 Ctrl-C, which leaves no half-written data set or video.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The recording.mcap of one or more runs, or the folders of the runs."""
    to: Annotated[str, tyro.conf.arg(constructor_factory=form_names, help=forms())]
    out: Annotated[Path | None, flag("PATH", "run.mp4 in the folder of each run, for mp4")] = None
    """Output folder; it must be empty or not exist yet. For mp4 of one run also the video, PATH.mp4, if there is none
    yet."""
    fps: Annotated[int | None, flag("INT", f"{LEROBOT_FPS} for lerobot, {VIDEO_FPS} for mp4")] = None
    """Frames per second: of the run's clock for lerobot, of the video for mp4."""
    images: bool = True
    """Include the pictures in the frames, for lerobot."""
    width_px: Annotated[int | None, flag("INT", "the camera's; 720 for an mp4 that is rendered")] = None
    """Width of the pictures of lerobot and mp4 [px]. Smaller: faster, and smaller files."""
    speed: float = 1.0
    """Seconds of the run per second of the video, for mp4. Larger: a faster and shorter video."""


def run(args: ExportArgs) -> int:
    """Read, convert and write the recordings, and print what was written."""
    _check(args)
    paths = [file / FILE_NAME if file.is_dir() else file for file in args.files]
    console = Console()
    if args.out is None and args.to != "mp4":
        raise InputError(f"--to {args.to} needs a folder: give --out, one that is empty or does not exist yet.")
    added = added_formats(OWN).get(args.to)
    # Before anything is written, so that one invalid file does not abort an export of many runs half way.
    incomplete = {path: text for path in paths if (text := missing_part(path))}
    if added is not None:
        added.check(paths)
    try:
        _write(args, added, paths, console)
    finally:
        if args.out is not None:
            release_claim(args.out)  # a data set has only its own files
    for path, text in incomplete.items():
        say(console, f"{path} is incomplete, and the export has the rest of it: {text}")
    return EXIT_OTHERWISE if incomplete else 0


def _write(args: ExportArgs, added: ExportFormat | None, paths: list[Path], console: Console) -> None:
    if args.to == "mp4":
        _to_videos(args, paths, console)
    elif args.out is not None:
        out = claim_run_folder(args.out)
        if added is not None:
            _to_added(added, paths, out, console)
        elif args.to == "lerobot":
            _to_lerobot(args, paths, out, console)
        else:
            _to_files(args, paths, out, console)


def _to_files(args: ExportArgs, paths: list[Path], out: Path, console: Console) -> None:
    for number, path in enumerate(paths):
        folder = out if len(paths) == 1 else out / f"{number:03d}"
        folder.mkdir(exist_ok=True)
        left_out = write_npz(path, folder) if args.to == "npz" else write_csv(path, folder)
        written = [file for file in folder.rglob("*") if file.is_file() and file.name != CLAIM]
        say(console, f"{folder}: {len(written)} files of {path}")
        if left_out:
            named = ", ".join(left_out[:MOST_NAMED]) + (", …" if len(left_out) > MOST_NAMED else "")
            say(console, f"not in the tables, because they are too long for a line (--to npz includes them): {named}")


def _check(args: ExportArgs) -> None:
    if not args.files:
        raise InputError("no recording is given; give one or more, e.g. dlokit export runs/<run> --to npz --out data.")
    if args.fps is not None and not 1 <= args.fps <= 100:
        raise InputError(f"--fps is {args.fps}; it must be 1 to 100 frames per second.")
    if args.width_px is not None and not 64 <= args.width_px <= 1920:
        raise InputError(f"--width-px is {args.width_px}; it must be 64 to 1920.")
    if not 0.1 <= args.speed <= 100.0:
        raise InputError(f"--speed is {args.speed:g}; it must be 0.1 to 100 seconds of the run per second.")


def _to_added(form: ExportFormat, paths: list[Path], out: Path, console: Console) -> None:
    with progress_bar(console) as progress:
        bar = progress.add_task("", total=None)

        def note(path: Path, done: int, total: int) -> None:
            progress.update(bar, description=str(path.parent), completed=done, total=total)

        lines = form.write(paths, out, note)
    for line in lines:
        say(console, line)


def _to_lerobot(args: ExportArgs, paths: list[Path], out: Path, console: Console) -> None:
    require_cell("dlokit export --to lerobot")
    from dlokit.extras.export.lerobot import DatasetOptions, write_lerobot

    options = DatasetOptions(fps=args.fps or LEROBOT_FPS, images=args.images, width_px=args.width_px)
    with progress_bar(console) as progress:
        bar = progress.add_task("", total=None)

        def note(path: Path, done: int, total: int) -> None:
            progress.update(bar, description=str(path.parent), completed=done, total=total)

        episodes = write_lerobot(paths, out, options, note)
    for number, one in enumerate(episodes):
        ended = {True: "success", False: "no success", None: "success unknown"}[one.success]
        say(console, f"episode {number}: {one.path}, {one.frames} frames, {ended}, task: {one.task}")
        if args.images:
            say(console, f"  pictures: {one.pictures}")
    frames = sum(one.frames for one in episodes)
    say(console, f"{out}: {len(paths)} episodes, {frames} frames at {options.fps} per second")


def _to_videos(args: ExportArgs, paths: list[Path], console: Console) -> None:
    require_cell("dlokit export --to mp4")
    from dlokit.extras.export.run_video import VideoOptions, write_run_video
    from dlokit.extras.export.video_file import ffmpeg_program

    ffmpeg = ffmpeg_program()
    if ffmpeg is None:
        say(console, "encoding takes a few minutes: with ffmpeg (sudo apt install ffmpeg) a third of the time")
    options = VideoOptions(fps=args.fps or VIDEO_FPS, speed=args.speed, width_px=args.width_px, ffmpeg=ffmpeg)
    for path, video in zip(paths, _videos(args.out, paths), strict=True):
        with progress_bar(console) as progress:
            bar = progress.add_task(str(video), total=None)

            def note(done: int, total: int, bar: Any = bar, progress: Progress = progress) -> None:
                progress.update(bar, completed=done, total=total)

            made = write_run_video(path, video, options, note)
        width_px, height_px = made.size_px
        say(console, f"{video}: {made.duration_s:.1f} s of {width_px} x {height_px} px; pictures: {made.pictures}")


def _videos(out: Path | None, paths: list[Path]) -> list[Path]:
    """Output file for the video of each recording. Raises `InputError` if one exists already."""
    if out is None:
        videos = [path.parent / VIDEO_NAME for path in paths]
    elif out.suffix == ".mp4":
        if len(paths) > 1:
            raise InputError(f"--out {out} is one video, and {len(paths)} runs are given: name a folder.")
        out.parent.mkdir(parents=True, exist_ok=True)
        videos = [out]
    else:
        folder = claim_run_folder(out)
        videos = [folder / f"{path.resolve().parent.name}.mp4" for path in paths]
    for number, video in enumerate(videos):
        if video.exists():
            raise InputError(f"{video} exists already; it is not overwritten: move it away, or choose another --out.")
        if video in videos[:number]:
            raise InputError(f"two runs would be written to {video}: export them separately.")
    return videos


COMMAND = CliCommand(ExportArgs, run)
