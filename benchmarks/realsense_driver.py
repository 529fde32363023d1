"""How long the RealSense driver needs from a frameset to the cloud, beside librealsense's own point cloud.

python benchmarks/realsense_driver.py
"""

import asyncio
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from dlokit.errors import ConfigError, MachineError, NoMorePictures
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import median
from dlokit.extras.cameras.realsense import RealSenseCamera, librealsense
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.skills.perception.config import PerceptionConfig, TableConfig
from dlokit.skills.perception.pipeline import observe
from dlokit.types.arrays import Float32Array
from dlokit.types.image import DepthImage
from parts.command import check_json, run_study, write_figures

_HELPERS = Path(__file__).resolve().parents[1] / "tests" / "helpers"
_WARM = 3
"""Framesets that are not measured: the first ones compile, allocate and load."""
ALIGN, CONVERT, CLOUD, DRIVER, THEIRS, DLO, ALL = (
    "align depth to colour (librealsense)",
    "frames to a depth image",
    "depth image to a cloud of all pixels",
    "frameset to the cloud, in all",
    "rs.pointcloud on the aligned frames",
    "depth image to the DLO's points",
    "frameset to the DLO's points, in all",
)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Play a file of librealsense, 640 x 480 px, through the driver, and time its parts on each frameset."""

    frames: int = 60
    """Framesets, of which the first 3 are not measured."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if not _WARM < args.frames <= 300:
        raise ConfigError(f"--frames {args.frames} must be from {_WARM + 1} to 300.")
    check_json(args.json)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cell.db3"
        _write(path, args.frames)
        taken = asyncio.run(_timed(path))
    if not taken[DRIVER]:
        raise MachineError(f"librealsense played none of {args.frames} framesets; repeat with more --frames.")
    console = Console(highlight=False, soft_wrap=True)
    rows = []
    for name, seconds in taken.items():
        middle = median(seconds)
        console.print(
            f"{name:38} {middle.value * 1e3:6.2f} ms (median of {middle.n}, at most {max(seconds) * 1e3:.2f})"
        )
        rows.append(figure("640 x 480 px", name, "time", middle, "s"))
    write_figures(args.json, "realsense_driver", rows, {"frames": args.frames}, console)
    return 0


def _write(path: Path, frames: int) -> None:
    """A file with pictures of the simulated D435, which look alike but for their noise."""
    sys.path.insert(0, str(_HELPERS))
    from realsense_recording import record

    cell = Cell(CellConfig(), seed=0)
    images = [cell.capture_depth() for _ in range(min(frames, 10))]
    cell.close()
    record(librealsense(), path, [images[number % len(images)] for number in range(frames)])


class _TimedCamera(RealSenseCamera):
    """The driver, with the times of its parts."""

    def __init__(self, file: Path, taken: dict[str, list[float]]) -> None:
        super().__init__(file=file)
        self._taken = taken
        self._points: Any = None

    def _image(self, frames: Any, stamp_ns: int) -> DepthImage:
        """Time the conversion, and librealsense's cloud of the same frames."""
        if self._points is None:
            self._points = librealsense().pointcloud()
        begin = time.perf_counter()
        np.asarray(self._points.calculate(frames.get_depth_frame()).get_vertices())
        self._taken[THEIRS].append(time.perf_counter() - begin)
        begin = time.perf_counter()
        image = super()._image(frames, stamp_ns)
        self._taken[CONVERT].append(time.perf_counter() - begin)
        return image

    def _connect(self) -> None:
        super()._connect()
        align = self._align.process

        def timed(frames: Any) -> Any:
            begin = time.perf_counter()
            aligned = align(frames)
            self._taken[ALIGN].append(time.perf_counter() - begin)
            return aligned

        self._align = _Aligner(process=timed)


@dataclass(frozen=True)
class _Aligner:
    process: Callable[[Any], Any]


async def _timed(path: Path) -> dict[str, list[float]]:
    taken: defaultdict[str, list[float]] = defaultdict(list)
    config = PerceptionConfig(table=TableConfig(correct_pose=False))
    with _TimedCamera(path, taken) as camera:
        while True:
            try:
                image = await camera.capture(2.0)
            except NoMorePictures:
                break
            begin = time.perf_counter()
            cloud(image)
            taken[CLOUD].append(time.perf_counter() - begin)
            taken[DRIVER].append(taken[ALIGN][-1] + taken[CONVERT][-1] + taken[CLOUD][-1])
            begin = time.perf_counter()
            observe(image, (), config, config.segmentation, 0.004)
            taken[DLO].append(time.perf_counter() - begin)
            taken[ALL].append(taken[ALIGN][-1] + taken[CONVERT][-1] + taken[DLO][-1])
    return {name: taken[name][_WARM:] for name in (ALIGN, CONVERT, CLOUD, DRIVER, THEIRS, DLO, ALL)}


def cloud(image: DepthImage) -> Float32Array:
    """The points (height, width, 3) [m] of all pixels in the camera frame, as rs.pointcloud gives them."""
    camera, z = image.calibration, image.depth_m
    points = np.empty((*z.shape, 3), dtype=np.float32)
    across = (np.arange(camera.width_px, dtype=np.float32) - np.float32(camera.cx_px)) / np.float32(camera.fx_px)
    down = (np.arange(camera.height_px, dtype=np.float32) - np.float32(camera.cy_px)) / np.float32(camera.fy_px)
    np.multiply(z, across, out=points[..., 0])
    np.multiply(z, down[:, None], out=points[..., 1])
    points[..., 2] = z
    return points


if __name__ == "__main__":
    run_study(Args, run, __doc__)
