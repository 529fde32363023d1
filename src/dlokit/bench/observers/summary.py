"""The default observer against the best peer, case by case, and against the bars that are set for it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dlokit.bench.observers.cases import ObserverCase
from dlokit.bench.observers.conditions import RECOVERED_WITHIN
from dlokit.bench.observers.figures import ALL_CASES
from dlokit.bench.observers.methods import PUBLISHED, default_name
from dlokit.bench.observers.metrics import CORRELATION, FLAGGED
from dlokit.bench.observers.runner import Trial
from dlokit.bench.report import BenchFigure, figure
from dlokit.evaluation.statistics import bootstrap

RATIO = "node error by the best peer's"
HALF = 0.5
"""The default observer's error is to be at most this share of the best peer's."""


@dataclass(frozen=True, kw_only=True)
class Bar:
    """What the default observer, or what stands in its place, is measured by in one case, without pins."""

    case: str
    metric: str
    most: float
    """In SI units; for what is to be large, the least."""
    is_least: bool = False
    method: str | None = None
    """None: the default observer."""

    def met(self, value: float) -> bool:
        """Whether a figure is good enough."""
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
"""Up to this share hidden no frame may be lost, in any case but the dark."""


def bars(cases: Sequence[ObserverCase]) -> tuple[Bar, ...]:
    """The bars of a run's cases: those of `BARS`, and no lost frame in any case with few hidden."""
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
        """Whether it is at most half."""
        return self.figure.value <= HALF


def compare(trials: Sequence[Trial], cases: Sequence[ObserverCase]) -> Iterator[Compared]:
    """A line for every case that the default observer and a peer have run, unpinned, over the seeds of both."""
    for case in cases:
        errors: dict[str, dict[int, float]] = {}
        for trial in trials:
            if trial.case == case.name:
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
            figure=_ratio(case.name, pairs),
            has_bar=not case.extra,
        )


def _ratio(case: str, pairs: np.ndarray) -> BenchFigure:
    """The ratio of means over sequences (n, 2), resampled by sequence: both errors of one belong together."""

    def statistic(samples: np.ndarray) -> np.ndarray:
        drawn = pairs[samples.astype(np.int64)]  # (resamples, n, 2)
        return drawn[:, :, 0].mean(axis=1) / np.maximum(drawn[:, :, 1].mean(axis=1), 1e-12)

    interval = bootstrap(np.arange(len(pairs)), np.random.default_rng(0), statistic=statistic)
    return figure(case, default_name(), RATIO, interval, "")
