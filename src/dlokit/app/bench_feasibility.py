"""`dlokit bench feasibility`: verdicts on goals against what the cell does."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit.app.machine import machine_facts
from dlokit.bench.feasibility import Happened, Judged, judge_all
from dlokit.bench.report import Figure, bench_json
from dlokit.bench.statistics import success_rate
from dlokit.description.dlo import PRESETS, preset
from dlokit.errors import ConfigError, ShapeError
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.feasibility import Standing


@dataclass(frozen=True, kw_only=True)
class FeasibilityArgs:
    """Compare the verdict on each goal with what the cell's DLO does when it is laid there and released for 2 s."""

    goals: Path | None = None
    """A .npy file (G, K, 3) of goals [m], scaled to the DLO; beside them the built-in shapes."""
    dlos: tuple[str, ...] = tuple(dlo.name for dlo in PRESETS)
    """Which DLOs."""
    threshold_m: float = 0.012
    """RMSE below which a goal counts as reached [m]."""
    json: Path | None = None
    """Also write every figure to this file."""


def run_feasibility(args: FeasibilityArgs) -> int:
    """Judge, release, print the confusion table; exit code 0."""
    if not args.threshold_m > 0.0:
        raise ConfigError(f"--threshold-m is {args.threshold_m}; it must be a number above 0.")
    config = RunConfig()
    console = Console()
    rows: list[Judged] = []
    for name in args.dlos:
        cell = replace(config.cell, dlo=preset(name))
        rows += judge_all(_curves(args.goals), cell, config.planning, args.threshold_m)
        console.print(_table(name, [row for row in rows if row.dlo == name]))
    if args.json is not None:
        args.json.write_bytes(bench_json("feasibility", _figures(rows), machine_facts(), config))
        console.print(f"figures: {args.json}")
    return 0


def _curves(path: Path | None) -> Mapping[str, Float64Array]:
    if path is None:
        return {}
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise ShapeError(f"Goals {path} cannot be read ({error}); give a .npy file of (G, K, 3) points [m].") from error
    if array.ndim != 3 or array.shape[2] != 3 or array.shape[1] < 2:
        raise ShapeError(f"Goals {path} are {array.shape}; they must be (G, K, 3) points [m] with K of 2 or more.")
    return {f"{path.name}:{index}": np.asarray(curve, dtype=np.float64) for index, curve in enumerate(array)}


def _table(title: str, rows: Sequence[Judged]) -> Table:
    counts = Counter((row.standing, row.happened) for row in rows)
    table = Table("verdict", *(happened.value.replace("_", " ") for happened in Happened), title=title)
    for standing in Standing:
        table.add_row(standing.value, *(str(counts[standing, happened]) for happened in Happened))
    return table


def _figures(rows: Sequence[Judged]) -> list[Figure]:
    figures: list[Figure] = []
    for dlo in dict.fromkeys(row.dlo for row in rows):
        for standing, right in ((Standing.HOLDS, Happened.STAYED), (Standing.INFEASIBLE, Happened.SPRANG_BACK)):
            said = [row for row in rows if row.dlo == dlo and row.standing is standing]
            if not said:
                continue
            rate = success_rate(sum(row.happened is right for row in said), len(said))
            figures.append(
                Figure(
                    case=dlo,
                    method="dlokit",
                    metric=f"{standing.value} is right",
                    value=rate.value,
                    low=rate.low,
                    high=rate.high,
                    unit="",
                    n=rate.n,
                )
            )
    return figures
