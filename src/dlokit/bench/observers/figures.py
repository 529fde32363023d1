"""From trials to figures: means over sequences with intervals, and what observers' health is worth over all cases."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dlokit.bench.observers.metrics import CORRELATION, CORRELATION_FRAMES, FLAGGED, METRICS, Metric
from dlokit.bench.observers.runner import Trial
from dlokit.bench.report import BenchFigure, figure
from dlokit.evaluation.statistics import Interval, bootstrap

ALL_CASES = "all cases"
"""The case of figures over the whole run; its units are seeds."""
_OVER_ALL = (CORRELATION, CORRELATION_FRAMES)


def figures(trials: Sequence[Trial]) -> list[BenchFigure]:
    """A row for each case, method and metric: the mean over its sequences, with a 95 % interval.

    The interval is bootstrapped over sequences: frames of one sequence depend on one another.
    """
    rows: list[BenchFigure] = []
    for case in dict.fromkeys(trial.case for trial in trials):
        for method in dict.fromkeys(trial.method for trial in trials):
            done = [trial for trial in trials if trial.case == case and trial.method == method]
            rows += [_row(case, method, metric, interval) for metric, interval in _of_case(done)]
    return rows + (_over_all(trials) if len({trial.case for trial in trials}) > 1 else [])


def _of_case(trials: Sequence[Trial]) -> Iterator[tuple[Metric, Interval]]:
    for metric in METRICS:
        if metric.name == FLAGGED:
            interval = flagged([[trial] for trial in trials])
        else:
            interval = _mean([trial.figures[metric.name] for trial in trials if metric.name in trial.figures])
        if interval is not None:
            yield metric, interval


def _over_all(trials: Sequence[Trial]) -> list[BenchFigure]:
    """What is stated against what is wrong, over all cases: a unit is a seed, whose cases share their motions."""
    rows: list[BenchFigure] = []
    for method in dict.fromkeys(trial.method for trial in trials):
        done = [trial for trial in trials if trial.method == method]
        by_seed = [[trial for trial in done if trial.seed == seed] for seed in dict.fromkeys(t.seed for t in done)]
        for metric in METRICS:
            interval = None
            if metric.name == FLAGGED:
                interval = flagged(by_seed)
            elif metric.name in _OVER_ALL:
                stated = [[t.figures[metric.name] for t in seed if metric.name in t.figures] for seed in by_seed]
                interval = _mean([float(np.mean(values)) for values in stated if values])
            if interval is not None:
                rows.append(_row(ALL_CASES, method, metric, interval))
    return rows


def flagged(units: Sequence[Sequence[Trial]]) -> Interval | None:
    """The share of lost tracks that health told, over independent units of trials; n counts losses, not units.

    None where no health is stated, or nothing was lost.
    """
    counts = np.array(
        [
            [sum(t.losses.count for t in unit if t.losses), sum(t.losses.flagged for t in unit if t.losses)]
            for unit in units
        ],
        dtype=np.float64,
    ).reshape(-1, 2)
    counts = counts[counts[:, 0] > 0]  # a unit without a loss says nothing about losses
    if len(counts) == 0:
        return None

    def share(samples: np.ndarray) -> np.ndarray:
        drawn = counts[samples.astype(np.int64)].sum(axis=1)
        return drawn[:, 1] / drawn[:, 0]

    interval = bootstrap(np.arange(len(counts)), np.random.default_rng(0), statistic=share)
    return replace(interval, n=int(counts[:, 0].sum()))


def _mean(values: Sequence[float]) -> Interval | None:
    # The resampling has a seed of its own: the same trials give the same interval.
    return bootstrap(values, np.random.default_rng(0)) if values else None


def _row(case: str, method: str, metric: Metric, interval: Interval) -> BenchFigure:
    return figure(case, method, metric.name, interval, metric.unit)
