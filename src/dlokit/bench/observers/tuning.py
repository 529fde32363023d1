"""Settings for every published method by the same search, on tuning seeds alone.

Run as `python -m dlokit.bench.observers.tuning cpd spr som pycpd probreg`. Each method gets `BUDGET` settings: its
defaults, `WIDE` - 1 spread evenly over its ranges (a Latin hypercube, in logarithms), and the rest over the third of
the ranges about the best of these. Each setting runs over `TUNING_CASES` with `TUNING_SEEDS`, and the lowest mean node
error wins. The winners are the defaults of the methods' settings.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import qmc

from dlokit.bench.observers.cases import BASE, TUNING_SEED, ObserverCase
from dlokit.bench.observers.clouds import Looks, looks
from dlokit.bench.observers.conditions import Conditions
from dlokit.bench.observers.methods import ObserverMethod
from dlokit.bench.observers.metrics import score
from dlokit.bench.observers.peers import ProbregConfig, PycpdConfig
from dlokit.bench.observers.runner import follow
from dlokit.bench.observers.sequence import Sequence as RodSequence
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig

TUNING_SEEDS = (TUNING_SEED, TUNING_SEED + 1)
TUNING_CASES = (
    BASE,
    ObserverCase(name="hidden 50 %", conditions=Conditions(hidden=0.5)),
    ObserverCase(name="swing", motion="swing"),
)
FRAMES = 30
BUDGET = 36
"""Settings a method."""
WIDE = 24
"""Settings of these that are spread over the whole ranges, the defaults among them."""

Range = tuple[float, float]
Given = Sequence[tuple[RodSequence, Looks]]

_MIXTURE: Mapping[str, Range] = {"beta_m": (0.05, 1.6), "outlier_weight": (0.02, 0.3), "initial_sigma_m": (0.01, 0.06)}
RANGES: Mapping[str, tuple[ObserverStrategyConfig, Mapping[str, Range]]] = {
    "cpd": (CpdConfig(), {**_MIXTURE, "lambda_per_m2": (10.0, 1e5)}),
    "spr": (
        SprConfig(),
        {
            **_MIXTURE,
            "lambda_per_m2": (10.0, 1e5),
            "tau_per_m2": (1e4, 1e8),
            "neighbours": (3, 12),
            "tau_annealing": (0.8, 1.0),
            "lambda_annealing": (0.9, 1.0),
        },
    ),
    "som": (
        SomConfig(),
        {
            "initial_radius": (1.0, 8.0),
            "final_radius": (0.3, 1.5),
            "gate_m": (0.01, 0.06),
            "shrunk": (0.7, 0.98),
            "torn": (1.5, 5.0),
            "empty": (0.1, 0.6),
        },
    ),
    "pycpd": (PycpdConfig(), {**_MIXTURE, "alpha_per_m2": (10.0, 1e5)}),
    "probreg": (
        ProbregConfig(),
        {"beta_m": (0.05, 1.6), "outlier_weight": (0.02, 0.3), "lambda_per_m2": (10.0, 1e5)},
    ),
}
"""The settings each search starts from, and what it varies between which bounds."""


@dataclass(frozen=True, kw_only=True)
class Tried:
    """One setting."""

    config: Any
    node_error_m: float


def tune(name: str, given: Given, budget: int = BUDGET, wide: int = WIDE) -> Iterator[Tried]:
    """Every setting of a method's search, with its mean node error [m], in the order in which they are tried."""
    start, ranges = RANGES[name]
    tried = [tried_of(start, given)]
    yield tried[0]
    for config in spread(start, ranges, wide - 1, seed=1):
        tried.append(tried_of(config, given))
        yield tried[-1]
    best = min(tried, key=lambda one: one.node_error_m).config
    for config in spread(best, narrowed(best, ranges), budget - wide, seed=2):
        yield tried_of(config, given)


def spread(config: Any, ranges: Mapping[str, Range], count: int, seed: int) -> Iterator[Any]:
    """`count` settings evenly spread over the ranges, in logarithms; whole numbers stay whole."""
    low, high = np.log([*ranges.values()]).T
    for row in qmc.LatinHypercube(d=len(ranges), rng=seed).random(count):
        values = dict(zip(ranges, np.exp(low + row * (high - low)).tolist(), strict=True))
        yield replace(
            config,
            **{name: round(at) if isinstance(getattr(config, name), int) else at for name, at in values.items()},
        )


def narrowed(best: Any, ranges: Mapping[str, Range]) -> dict[str, Range]:
    """The third of each range about a setting, in logarithms, within the range."""
    narrow: dict[str, Range] = {}
    for name, (low, high) in ranges.items():
        sixth = (high / low) ** (1.0 / 6.0)
        at = float(getattr(best, name))
        narrow[name] = (min(max(at / sixth, low), high), max(min(at * sixth, high), low))
    return narrow


def tried_of(config: ObserverStrategyConfig, given: Given) -> Tried:
    """The mean node error [m] of a setting over sequences."""
    errors = [score(follow(sequence, seen, ObserverMethod(config=config)))["node error"] for sequence, seen in given]
    return Tried(config=config, node_error_m=float(np.mean(errors)))


def tuning_sequences(frames: int = FRAMES) -> Given:
    """The tuning cases with the tuning seeds; made once, for all settings."""
    return [
        (sequence, looks(sequence, case.conditions, seed))
        for case in TUNING_CASES
        for seed in TUNING_SEEDS
        for sequence in (case.sequence(seed, frames),)
    ]


def main(names: Sequence[str]) -> None:
    """Search for each method in turn; print each setting as it is done, then the best."""
    given = tuning_sequences()
    for name in names or list(RANGES):
        tried: list[Tried] = []
        for one in tune(name, given):
            tried.append(one)
            print(_line(one), flush=True)
        print(f"best of {len(tried)} for {name}:", _line(min(tried, key=lambda one: one.node_error_m)), flush=True)


def _line(one: Tried) -> str:
    return f"{one.node_error_m * 1e3:6.1f} mm  {one.config}"


if __name__ == "__main__":
    main(sys.argv[1:])
