"""Search the settings of every published observer in the same way, on seeds that no bench reports.

    python benchmarks/tuning.py
    python benchmarks/tuning.py cpd som --json tuned.json

Each method gets the same number of settings (--budget): its defaults, most of the others spread evenly over its ranges
(a Latin hypercube, in logarithms), and the rest over the third of the ranges about the best of these. Each setting runs
over three cases of `dlokit bench observers` with two tuning seeds; the setting with the lowest mean node error wins.
Prints each setting with its error, then the best. The winners are the defaults of the methods' settings. pycpd and
probreg are searched where they are installed: pip install '.[bench]', pip install probreg.
"""

from dlokit.app.environment import prepare_environment

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console
from scipy.stats import qmc

from dlokit.errors import ConfigError
from dlokit.extras.bench.observers.cases import BASE, TUNING_SEED, ObserverCase
from dlokit.extras.bench.observers.clouds import Looks
from dlokit.extras.bench.observers.conditions import Conditions
from dlokit.extras.bench.observers.methods import ObserverMethod, ProbregConfig, PycpdConfig
from dlokit.extras.bench.observers.metrics import score
from dlokit.extras.bench.observers.runner import follow
from dlokit.extras.bench.observers.sequence import Sequence as RodSequence
from dlokit.extras.bench.report import BenchFigure
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig
from parts.command import check_json, run_study, write_figures

TUNING_SEEDS = (TUNING_SEED, TUNING_SEED + 1)
TUNING_CASES = (
    BASE,
    ObserverCase(name="hidden 50 %", conditions=Conditions(hidden=0.5)),
    ObserverCase(name="swing", motion="swing"),
)
WIDE = 2 / 3
"""Fraction of the settings that is spread over the whole ranges, the defaults among them."""

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


def tune(name: str, given: Given, budget: int) -> Iterator[Tried]:
    """Every setting of a method's search, with its mean node error [m], in the order in which they are tried."""
    start, ranges = RANGES[name]
    wide = max(1, round(WIDE * budget))
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


def tuning_sequences(frames: int) -> Given:
    """The tuning cases with the tuning seeds; made once, for all settings."""
    return [
        (sequence, Looks(sequence, case.conditions, seed))
        for case in TUNING_CASES
        for seed in TUNING_SEEDS
        for sequence in (case.sequence(seed, frames),)
    ]


@dataclass(frozen=True, kw_only=True)
class Args:
    """Search the settings of published observers on tuning seeds."""

    methods: Annotated[tuple[str, ...], tyro.conf.Positional] = tuple(RANGES)
    """Methods to tune: cpd, spr, som, pycpd, probreg."""
    budget: int = 36
    """Settings tried for each method."""
    frames: int = 30
    """Frames of each sequence."""
    json: Path | None = None
    """Also write the error of the best setting of each method to this file."""


def run(args: Args) -> int:
    """Search for each method in turn; print each setting as it is done, then the best; exit code 0."""
    if unknown := [name for name in args.methods if name not in RANGES]:
        raise ConfigError(f"{', '.join(unknown)}: there is no such method; choose of {', '.join(RANGES)}.")
    if args.budget < 1 or args.frames < 2:
        raise ConfigError(f"--budget {args.budget} must be at least 1, and --frames {args.frames} at least 2.")
    check_json(args.json)
    console = Console(width=240, highlight=False)
    given = tuning_sequences(args.frames)
    best: dict[str, Tried] = {}
    for name in args.methods:
        tried: list[Tried] = []
        for one in tune(name, given, args.budget):
            tried.append(one)
            console.print(f"{name} {len(tried)}/{args.budget}: {_line(one)}")
        best[name] = min(tried, key=lambda one: one.node_error_m)
        console.print(f"best of {len(tried)} for {name}: {_line(best[name])}")
    config = {
        "budget": args.budget,
        "frames": args.frames,
        "best": {name: str(one.config) for name, one in best.items()},
    }
    write_figures(args.json, "tuning", [_figure(name, one, len(given)) for name, one in best.items()], config, console)
    return 0


def _line(one: Tried) -> str:
    return f"{one.node_error_m * 1e3:6.1f} mm  {one.config}"


def _figure(name: str, best: Tried, sequences: int) -> BenchFigure:
    return BenchFigure(
        case="tuning seeds",
        method=name,
        metric="node error of the best setting",
        value=best.node_error_m,
        low=None,
        high=None,
        unit="m",
        n=sequences,
    )


if __name__ == "__main__":
    run_study(Args, run, __doc__)
