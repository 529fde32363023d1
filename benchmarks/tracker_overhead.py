"""What `dlokit.Tracker.update` costs beside the observer alone: the same clouds, in turn, in one process.

`update` also thins them.

python benchmarks/tracker_overhead.py
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

import dlokit
from dlokit.app.library.tracker import filtered
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import median
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import prior_from
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.following import followed
from dlokit.skills.perception.config import CloudConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import TargetPoints
from dlokit.types.observation import Observation
from parts.command import check_json, run_study, write_figures

PERIOD_NS = 33_333_333


@dataclass(frozen=True, kw_only=True)
class Args:
    """Time `Tracker.update` and the observer alone on clouds of a rod that sways."""

    clouds: int = 300
    """Number of clouds."""
    points: int = 1500
    """Points of each cloud."""
    json: Path | None = None
    """Write the figures to this file."""


def swaying_cloud(number: int, points: int) -> Float64Array:
    """A cloud (points, 3) [m] with 2 mm noise of a rod that moves to and fro by 5 cm."""
    t = np.linspace(0.0, 1.0, points)
    y = 0.06 * np.sin(4.0 * t) + 0.05 * np.sin(0.2 * number)
    clean = np.column_stack([0.3 + 0.4 * t, y, np.full(points, 0.004)])
    return clean + np.random.default_rng(number).normal(0.0, 0.002, clean.shape)


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if args.clouds < 2 or args.points < 100:
        raise ConfigError(f"--clouds {args.clouds} must be at least 2, and --points {args.points} at least 100.")
    check_json(args.json)
    t = np.linspace(0.0, 1.0, 1000)
    length_m = float(np.sum(np.hypot(0.4 * np.diff(t), np.diff(0.06 * np.sin(4.0 * t)))))
    tracker = dlokit.Tracker(length_m=length_m)
    config, topology = ObserverConfig(), chain(BelievedDlo.nodes, length_m)
    strategy = config.strategy.build(BelievedDlo(length_m=length_m))
    last = tracker.update(swaying_cloud(0, args.points))
    whole_s: list[float] = []
    alone_s: list[float] = []
    for number in range(1, args.clouds):
        cloud, stamp_ns = swaying_cloud(number, args.points), last.stamp_ns + PERIOD_NS
        thinned = filtered(cloud, CloudConfig.voxel_m)
        seen = Observation(stamp_ns=stamp_ns, points_world=thinned.astype(np.float32))
        targets = TargetPoints(
            stamp_ns=last.stamp_ns,
            nodes_world=last.positions_world,
            visible=last.visible,
            covariance=last.covariance,
            health=last.health,
        )
        begin_s = time.perf_counter()
        followed(strategy, seen, prior_from(targets, topology), config)
        between_s = time.perf_counter()
        last = tracker.update(cloud, stamp_ns=stamp_ns)
        whole_s.append(time.perf_counter() - between_s)
        alone_s.append(between_s - begin_s)
    whole, alone = median(whole_s), median(alone_s)
    ratio = median([one / other for one, other in zip(whole_s, alone_s, strict=True)])
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"Tracker.update {whole.value * 1e3:.2f} ms, observer alone {alone.value * 1e3:.2f} ms")
    console.print(f"ratio {ratio.value:.2f}, 95 % {ratio.low:.2f} to {ratio.high:.2f}, medians of {ratio.n} clouds")
    rows = [
        figure("swaying rod", "Tracker.update", "time", whole, "s"),
        figure("swaying rod", "observer alone", "time", alone, "s"),
        figure("swaying rod", "Tracker.update", "time over that of the observer alone", ratio, ""),
    ]
    write_figures(args.json, "tracker_overhead", rows, {"clouds": args.clouds, "points": args.points}, console)
    return 0


if __name__ == "__main__":
    run_study(Args, run, __doc__)
