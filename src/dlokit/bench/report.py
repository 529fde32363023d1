"""Figures of a bench: an overview for people, rows of JSON for programs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

import msgspec
import numpy as np

from dlokit import __version__
from dlokit.bench.shaping import CaseResult
from dlokit.bench.simulation import Timing
from dlokit.bench.statistics import Interval, bootstrap, success_rate
from dlokit.system.config import RunConfig
from dlokit.system.run_result import RunResult
from dlokit.system.toml_config import to_plain
from dlokit.types.flow import RunOutcome


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One row of the JSON file: one figure with its 95 % interval, in SI units."""

    case: str
    method: str
    metric: str
    value: float
    low: float | None
    high: float | None
    unit: str
    n: int


def figures(results: Sequence[CaseResult]) -> list[Figure]:
    """Success rate, and medians over the runs of each experiment."""
    rows: list[Figure] = []
    for name, method, runs in _by_experiment(results):
        wins = sum(run.outcome is RunOutcome.CONVERGED for run in runs)
        rows.append(_figure(name, "converged", success_rate(wins, len(runs)), "", method))
        for metric, unit in (
            ("actions", ""),
            ("rmse_m", "m"),
            ("true_rmse_m", "m"),
            ("sim_time_s", "s"),
            ("wall_time_s", "s"),
            ("planning_time_s", "s"),
        ):
            values = [float(value) for run in runs if (value := getattr(run, metric)) is not None]
            if values:
                rows.append(_figure(name, f"median {metric}", _median(values), unit, method))
    return rows


def timing_figures(timings: Sequence[Timing]) -> list[Figure]:
    """Median time of each part."""
    return [_figure(timing.part, f"median time a {timing.per}", _median(timing.seconds), "s") for timing in timings]


def bench_json(bench: str, rows: Sequence[Figure], machine: Mapping[str, str], config: RunConfig) -> bytes:
    """The file that ``--json`` writes."""
    content = {
        "bench": bench,
        "version": __version__,
        "machine": dict(machine),
        "config": to_plain(config),
        "rows": [asdict(row) for row in rows],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"


def overview(results: Sequence[CaseResult]) -> Iterator[tuple[str, ...]]:
    """A row an experiment and method: both, converged, interval, actions, RMSE, true RMSE, robot seconds, pace."""
    for name, method, runs in _by_experiment(results):
        wins = sum(run.outcome is RunOutcome.CONVERGED for run in runs)
        rate = success_rate(wins, len(runs))
        yield (
            name,
            method,
            f"{wins}/{len(runs)}",
            f"{rate.low:.2f} to {rate.high:.2f}",
            spread([run.actions for run in runs], "{:.0f}"),
            spread([run.rmse_m * 1e3 for run in runs if run.rmse_m is not None], "{:.1f}"),
            spread([run.true_rmse_m * 1e3 for run in runs if run.true_rmse_m is not None], "{:.1f}"),
            spread([run.sim_time_s for run in runs], "{:.0f}"),
            spread([run.sim_time_s / run.wall_time_s for run in runs], "{:.1f}") + " ×",
        )


def _median(values: Sequence[float]) -> Interval:
    # The resampling has a seed of its own: the same runs give the same interval.
    return bootstrap(values, np.random.default_rng(0), statistic=lambda samples: np.median(samples, axis=1))


def spread(values: Sequence[float], form: str) -> str:
    """Median, smallest and largest, each in the format `form`."""
    if not values:
        return "-"
    return f"{form.format(np.median(values))} ({form.format(min(values))} to {form.format(max(values))})"


def _by_experiment(results: Sequence[CaseResult]) -> Iterator[tuple[str, str, list[RunResult]]]:
    for name, method in dict.fromkeys((done.case.experiment.name, done.case.method.name) for done in results):
        yield (
            name,
            method,
            [done.result for done in results if done.case.experiment.name == name and done.case.method.name == method],
        )


def _figure(case: str, metric: str, interval: Interval, unit: str, method: str = "dlokit") -> Figure:
    return Figure(
        case=case,
        method=method,
        metric=metric,
        value=interval.value,
        low=interval.low,
        high=interval.high,
        unit=unit,
        n=interval.n,
    )
