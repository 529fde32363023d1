"""How long `dlokit export --to mp4` takes beside another version, and how much the two videos differ.

    git worktree add /tmp/before <commit>
    python benchmarks/video_export.py runs/<run> --beside /tmp/before/src

Both versions export the run in turn, each in a process of its own, so that both meet the same load. Without `--beside`
the other one is this version without the program ffmpeg, whose videos OpenCV encodes.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from rich.console import Console

import dlokit
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import without_interval
from parts.command import check_json, count_in, figures_table, run_study, value_in, write_figures

CPU, WALL, APART = "processor time, median", "wall time, median", "difference of the pictures, mean"
_PYTHONS = Path(sys.executable).parent


@dataclass(frozen=True, kw_only=True)
class Args:
    """Export a run as a video by two versions of dlokit, and compare times and pictures."""

    run: Annotated[Path, tyro.conf.Positional]
    """The folder of a run."""
    beside: Path | None = None
    """The folder `src` of the other version; None: this one, without ffmpeg."""
    times: int = 3
    """Exports by each version."""
    json: Path | None = None
    """Also write all figures to this file."""


def run(args: Args) -> int:
    """Measure and print."""
    if args.times < 1:
        raise ConfigError(f"--times is {args.times}; it must be 1 or greater.")
    check_json(args.json)
    console = Console()
    here = Path(dlokit.__file__).parents[1]
    times: dict[str, list[tuple[float, float]]] = {"before": [], "now": []}
    with tempfile.TemporaryDirectory() as folder:
        # Without a PATH beyond Python's own folder no program ffmpeg is found.
        bare = os.environ | ({"PATH": str(_PYTHONS)} if args.beside is None else {})
        for number in range(args.times):
            for case, source, environment in (("before", args.beside or here, bare), ("now", here, dict(os.environ))):
                video = Path(folder) / f"{case}-{number}.mp4"
                times[case].append(_export(args.run, video, environment | {"PYTHONPATH": str(source.resolve())}))
        apart = _apart(Path(folder) / "before-0.mp4", Path(folder) / "now-0.mp4")
    figures: list[BenchFigure] = []
    for case, measured in times.items():
        for metric, values in zip((CPU, WALL), zip(*measured, strict=True), strict=True):
            figures.append(figure(case, "dlokit", metric, without_interval(statistics.median(values), args.times), "s"))
    figures.append(figure("now", "dlokit", APART, without_interval(apart, 1), "1"))
    columns = {"n": count_in(CPU), "processor": value_in(CPU, digits=1), "wall": value_in(WALL, digits=1)}
    console.print(figures_table("dlokit export --to mp4", "s", figures, columns))
    console.print(f"the two videos differ by {apart:.2f} of 255 (mean over pixels and pictures)", highlight=False)
    write_figures(args.json, "video_export", figures, {"times": args.times}, console)
    return 0


def _export(run: Path, video: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Processor and wall time of an export [s], its encoder included."""
    before, begin_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "dlokit", "export", str(run), "--to", "mp4", "--out", str(video)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    after, wall_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin_s
    if done.returncode:
        raise ConfigError(f"the export failed: {done.stderr.strip()}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall_s


def _apart(first: Path, second: Path) -> float:
    """Mean difference of two videos' pixels. Raises `ConfigError` where they have not the same pictures."""
    videos = [cv2.VideoCapture(str(path)) for path in (first, second)]
    differences: list[float] = []
    while True:
        (left_read, left), (right_read, right) = (video.read() for video in videos)
        if not (left_read and right_read):
            break
        differences.append(float(np.mean(cv2.absdiff(left, right))))
    if left_read or right_read:
        raise ConfigError(f"one video ends after {len(differences)} pictures, the other does not")
    return statistics.fmean(differences)


if __name__ == "__main__":
    run_study(Args, run, __doc__)
