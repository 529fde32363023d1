"""Figures of the trials: means with intervals, and the default observer compared with the best peer and its bars."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlokit.extras.bench.observers.cases import ObserverCase
from dlokit.extras.bench.observers.conditions import RECOVERED_WITHIN
from dlokit.extras.bench.observers.methods import PUBLISHED, default_name
from dlokit.extras.bench.observers.metrics import CORRELATION, CORRELATION_FRAMES, FLAGGED, METRICS, Metric
from dlokit.extras.bench.observers.runner import Trial
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import Interval, bootstrap
from dlokit.types.arrays import Float64Array

ALL_CASES = "all cases"
"""Case name of figures over the whole run; its units are seeds."""
_OVER_ALL = (CORRELATION, CORRELATION_FRAMES)


def figures(trials: Sequence[Trial]) -> list[BenchFigure]:
    """One row for each case, method and metric: the mean over its sequences, with a 95 % interval.

    The interval is bootstrapped over sequences, because frames of one sequence are not independent.
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
    """Stated uncertainty compared with errors, over all cases; a unit is a seed, whose cases have common motions."""
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
    """The fraction of lost tracks that health detected, over independent units; n counts losses, not units.

    None if no health is stated, or nothing was lost.
    """
    counts = np.array(
        [
            [sum(t.losses.flagged for t in unit if t.losses), sum(t.losses.count for t in unit if t.losses)]
            for unit in units
        ],
        dtype=np.float64,
    ).reshape(-1, 2)
    counts = counts[counts[:, 1] > 0]  # a unit without a loss gives no information about losses
    return replace(_ratio(counts), n=int(counts[:, 1].sum())) if len(counts) else None


def _ratio(pairs: Float64Array) -> Interval:
    """The ratio of the means of both columns (n, 2), resampled by row, as both numbers of a row belong together."""

    def statistic(samples: np.ndarray) -> np.ndarray:
        drawn = pairs[samples.astype(np.int64)]  # (resamples, n, 2)
        return drawn[:, :, 0].mean(axis=1) / np.maximum(drawn[:, :, 1].mean(axis=1), 1e-12)

    return bootstrap(np.arange(len(pairs)), np.random.default_rng(0), statistic=statistic)


def _mean(values: Sequence[float]) -> Interval | None:
    # The resampling has its own seed: the same trials give the same interval.
    return bootstrap(values, np.random.default_rng(0)) if values else None


def _row(case: str, method: str, metric: Metric, interval: Interval) -> BenchFigure:
    return figure(case, method, metric.name, interval, metric.unit)


RATIO = "node error by the best peer's"
HALF = 0.5
"""Maximum ratio of the default observer's error to the best peer's."""


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A required figure of the default observer, or of another method, in one case, without pins."""

    case: str
    metric: str
    most: float
    """The limit in SI units; a minimum if `is_least`."""
    is_least: bool = False
    method: str | None = None
    """None: the default observer."""

    def met(self, value: float) -> bool:
        """Whether a figure satisfies the bar."""
        return value >= self.most if self.is_least else value <= self.most


BARS: tuple[Bar, ...] = (
    Bar(case="base", metric="node error", most=0.008),
    Bar(case="hidden 50 %", metric="node error", most=0.016),
    Bar(case="swing 1 m/s", metric="node error", most=0.010),
    Bar(case="2000 points", metric="time p50", most=0.002),
    Bar(case="2000 points", metric="time p99", most=0.005),
    Bar(case="dark for 1 s", metric="frames to recover", most=RECOVERED_WITHIN),
    Bar(case=ALL_CASES, metric=CORRELATION, most=0.6, is_least=True),
    Bar(case=ALL_CASES, metric=FLAGGED, most=0.95, is_least=True),
    Bar(case="one iteration, 2000 points", metric="times cpd's", most=15.0, is_least=True, method="pycpd"),
)
FEW_HIDDEN = 0.3
"""Up to this hidden fraction no frame may be lost, in any case except the dark."""


def bars(cases: Sequence[ObserverCase]) -> tuple[Bar, ...]:
    """The bars of a run's cases: those of `BARS`, and no lost frame in any case with a small hidden fraction."""
    few = [case for case in cases if case.file is None and not case.extra and case.conditions.hidden <= FEW_HIDDEN]
    return BARS + tuple(
        Bar(case=case.name, metric="frames over 50 mm", most=0.0) for case in few if case.conditions.dark_s == 0.0
    )


@dataclass(frozen=True, kw_only=True)
class Compared:
    """The default observer and the best peer in one case."""

    case: str
    own_m: float
    peer: str
    peer_m: float
    figure: BenchFigure
    """Their ratio, with its interval over sequences."""
    has_bar: bool

    @property
    def met(self) -> bool:
        """Whether the ratio is at most one half."""
        return self.figure.value <= HALF


def compare(trials: Sequence[Trial], cases: Sequence[ObserverCase]) -> Iterator[Compared]:
    """Compare default observer and best peer, without pins, in every common case, over their common seeds."""
    for case in cases:
        errors: dict[str, dict[int, float]] = {}
        for trial in trials:
            if trial.case == case.name and "node error" in trial.figures:
                errors.setdefault(trial.method, {})[trial.seed] = trial.figures["node error"]
        own = errors.get(default_name(), {})
        peers = {name: errors[name] for name in PUBLISHED if name in errors and name != default_name()}
        seeds = sorted(set(own).intersection(*peers.values()))  # an early end leaves some methods a seed behind
        if not seeds or not peers:
            continue
        best = min(peers, key=lambda name: np.mean([peers[name][seed] for seed in seeds]))
        pairs = np.array([[own[seed], peers[best][seed]] for seed in seeds])
        yield Compared(
            case=case.name,
            own_m=float(pairs[:, 0].mean()),
            peer=best,
            peer_m=float(pairs[:, 1].mean()),
            figure=figure(case.name, default_name(), RATIO, _ratio(pairs), ""),
            has_bar=not case.extra,
        )
