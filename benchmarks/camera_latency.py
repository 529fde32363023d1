"""How well `dlokit calibrate latency` finds by how much the stamps of a camera are late, over seeds of the cell."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit.app.calibrate.latency import measured_in_cell
from dlokit.benches.report import BenchFigure, figure
from dlokit.errors import ConfigError
from dlokit.evaluation.statistics import Interval, bootstrap
from dlokit.skills.perception.calibration.latency import LatencyFit
from dlokit.system.calibration import CAMERA_LATE_S
from parts.command import check_json, run_study, write_figures

_CASE = "80 ms late, clock 50 ppm fast"
_BAR_S = 0.005


@dataclass(frozen=True, kw_only=True)
class Args:
    """Measure the latency of the cell's camera, whose pictures come 80 ms late and whose clock is 50 ppm fast.

    Each seed has other noise, another error of the camera's pose, other offsets of the joints and other poses of the
    arm. An error above 5 ms, in which a hand at 0.3 m/s moves by 1.5 mm, is a failure.
    """

    seeds: int = 10
    """Measurements, with seeds 0 to K-1."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure with every seed and print; exit code 0 where no error is above 5 ms, else 1."""
    if args.seeds < 1:
        raise ConfigError(f"--seeds is {args.seeds}; it must be at least 1.")
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    fits: list[LatencyFit] = []
    for seed in range(args.seeds):
        fit = measured_in_cell(seed)
        fits.append(fit)
        console.print(
            f"seed {seed:2}: {fit.late_s * 1e3:.2f} ms, error {(fit.late_s - CAMERA_LATE_S) * 1e3:+.2f} ms, to "
            f"{fit.uncertainty_s * 1e3:.2f} ms (95 %), {fit.pictures} pictures"
        )
    write_figures(args.json, "camera latency", _figures(fits, console), {"seeds": args.seeds}, console)
    return 0 if all(abs(fit.late_s - CAMERA_LATE_S) <= _BAR_S for fit in fits) else 1


def _figures(fits: list[LatencyFit], console: Console) -> list[BenchFigure]:
    errors_s = np.abs([fit.late_s - CAMERA_LATE_S for fit in fits])
    mean = bootstrap(errors_s, np.random.default_rng(0))
    # The largest of a few has no interval.
    largest = Interval(value=float(errors_s.max()), low=None, high=None, n=len(fits))
    within = float(np.mean([abs(fit.late_s - CAMERA_LATE_S) <= fit.uncertainty_s for fit in fits]))
    console.print(
        f"|error| of {len(fits)} seeds: mean {mean.value * 1e3:.2f} ms, at most {largest.value * 1e3:.2f} ms; within "
        f"its own 95 % interval in {within:.0%}"
    )
    return [
        figure(_CASE, "board in the moving hand", "mean |error|", mean, "s"),
        figure(_CASE, "board in the moving hand", "largest |error|", largest, "s"),
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
