"""How many stereo pairs per second the GenICam driver takes, and how far apart the two exposures of a pair are.

python benchmarks/genicam_driver.py
"""

import asyncio
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from dlokit import geometry
from dlokit.errors import ConfigError, MachineError
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import median
from dlokit.extras.cameras.genicam import GenicamPair
from dlokit.types.image import CameraCalibration
from parts.command import check_json, run_study, write_figures

_HELPERS = Path(__file__).resolve().parents[1] / "tests" / "helpers"
_TIMEOUT_S = 2.0


@dataclass(frozen=True, kw_only=True)
class Args:
    """Take pairs of two of aravis's fake GigE Vision cameras, which expose 25 times per second at most."""

    pairs: int = 250
    """Pairs that are taken."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if not 3 <= args.pairs <= 100_000:
        raise ConfigError(f"--pairs {args.pairs} must be from 3 to 100000.")
    check_json(args.json)
    sys.path.insert(0, str(_HELPERS))
    from genicam_cameras import SERIALS, SIZE_PX, two_cameras, why_not

    if reason := why_not():
        raise MachineError(reason)
    optics = CameraCalibration(
        width_px=SIZE_PX[0],
        height_px=SIZE_PX[1],
        fx_px=600.0,
        fy_px=600.0,
        cx_px=SIZE_PX[0] / 2,
        cy_px=SIZE_PX[1] / 2,
        baseline_m=0.1,
        T_world_camera=geometry.pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)),
    )
    with two_cameras():
        seconds, skews_s = asyncio.run(_taken(GenicamPair(*SERIALS, optics), args.pairs))
    console = Console(highlight=False, soft_wrap=True)
    rate, skew = len(seconds) / sum(seconds), median(skews_s)
    ordered = sorted(skews_s)
    console.print(f"{rate:.1f} pairs/s of {SIZE_PX[0]} x {SIZE_PX[1]} px")
    console.print(
        f"skew {skew.value * 1e3:.2f} ms (median), {ordered[int(0.95 * len(ordered))] * 1e3:.2f} (p95), "
        f"{ordered[-1] * 1e3:.2f} (largest of {len(ordered)})"
    )
    rows = [
        figure("two fake cameras", "driver", "time per pair", median(seconds), "s"),
        figure("two fake cameras", "driver", "skew", skew, "s"),
    ]
    write_figures(args.json, "genicam_driver", rows, {"pairs": args.pairs}, console)
    return 0


async def _taken(camera: GenicamPair, pairs: int) -> tuple[list[float], list[float]]:
    """Time of each pair, and the absolute difference of its two exposures [s]."""
    seconds, skews_s = list[float](), list[float]()
    with camera:
        await camera.capture(_TIMEOUT_S)
        for _ in range(pairs):
            begin = time.perf_counter()
            await camera.capture(_TIMEOUT_S)
            seconds.append(time.perf_counter() - begin)
            skews_s.append(abs(camera.skew_ns) * 1e-9)
    return seconds, skews_s


if __name__ == "__main__":
    run_study(Args, run, __doc__)
