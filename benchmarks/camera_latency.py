"""How well `dlokit calibrate latency` finds by how much the stamps of a camera are late, over seeds of the cell."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit.app.commands import execute
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import Interval, bootstrap, success_rate
from dlokit.extras.calibration.cell_pictures import CAMERA_LATE_S
from dlokit.functional.cameras.calibration_file import MeasuredLatency, read_calibration, read_part
from dlokit.types.arrays import BoolArray, Float64Array
from parts.command import check_json, run_study, write_figures

_CASE = "80 ms late, clock 50 ppm fast"
_METHOD = "board in the moving hand"
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
    """Measure with every seed, and print; exit code 0."""
    if args.seeds < 1:
        raise ConfigError(f"--seeds is {args.seeds}; it must be at least 1.")
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    late_s: list[float] = []
    within: list[bool] = []
    for seed in range(args.seeds):
        found_s, measured = measured_in_cell(seed)
        late_s.append(found_s)
        within.append(abs(found_s - CAMERA_LATE_S) <= measured.uncertainty_s)
        console.print(
            f"seed {seed:2}: {found_s * 1e3:.2f} ms, error {(found_s - CAMERA_LATE_S) * 1e3:+.2f} ms, to "
            f"{measured.uncertainty_s * 1e3:.2f} ms (95 %), {measured.pictures} pictures"
        )
    rows = _figures(np.abs(np.subtract(late_s, CAMERA_LATE_S)), np.array(within, dtype=np.bool_), console)
    write_figures(args.json, "camera latency", rows, {"seeds": args.seeds}, console)
    return 0


def measured_in_cell(seed: int) -> tuple[float, MeasuredLatency]:
    """The latency that the command finds with a seed [s], and what it says of it."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "latency"
        execute(["calibrate", "latency", "--seed", str(seed), "--out", str(out)])
        file = out / "calibration.toml"
        measured = read_part(file, MeasuredLatency)
        assert measured is not None, "the command writes it"
        return read_calibration(file).stamps_late_s, measured


def _figures(errors_s: Float64Array, within: BoolArray, console: Console) -> list[BenchFigure]:
    mean = bootstrap(errors_s, np.random.default_rng(0))
    # The largest of a few has no interval.
    largest = Interval(value=float(errors_s.max()), low=None, high=None, n=len(errors_s))
    inside = success_rate(int(within.sum()), len(within))
    passed = success_rate(int(np.sum(errors_s <= _BAR_S)), len(errors_s))
    console.print(
        f"|error| of {len(errors_s)} seeds: mean {mean.value * 1e3:.2f} ms, at most {largest.value * 1e3:.2f} ms; "
        f"{passed.value:.0%} within 5 ms, {inside.value:.0%} within their own 95 % interval"
    )
    return [
        figure(_CASE, _METHOD, "mean |error|", mean, "s"),
        figure(_CASE, _METHOD, "largest |error|", largest, "s"),
        figure(_CASE, _METHOD, "|error| at most 5 ms", passed, "1"),
        figure(_CASE, _METHOD, "|error| within its own 95 % interval", inside, "1"),
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
