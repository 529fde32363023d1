"""The time of one iteration of coherent point drift in dlokit, pycpd and probreg, alternating on the same input.

`dlokit bench observers` prints it. Each method fits the same nodes to the same cloud from the same variance with the
same settings and without convergence, so that iteration k is the same in all of them. The setup before the first
iteration is timed separately.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from rich.table import Table

from dlokit.errors import MachineError
from dlokit.extras.bench.observers.methods import imported
from dlokit.extras.bench.report import BenchFigure
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.mixture import MixtureFit, Weights
from dlokit.types.arrays import Float64Array

POINTS = (500, 1000, 2000)
NODES = 50
ITERATIONS = 30
REPEATS = 10
DLOKIT = "cpd"
SETTINGS = CpdConfig(beta_m=0.12, lambda_per_m2=300.0, outlier_weight=0.05, initial_sigma_m=0.03)

Iterate = Callable[[], object]
Start = Callable[[Float64Array, Float64Array], Iterate]
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class IterationTimes:
    """Times of one method for one size of cloud."""

    method: str
    points: int
    iterations_s: Float64Array
    """Processor time of each iteration [s]."""
    setups_s: Float64Array
    """Processor time of each fit before its first iteration [s]."""

    def quantile_s(self, fraction: float) -> float:
        """Quantile of the times of the iterations [s]."""
        return float(np.quantile(self.iterations_s, fraction))


def measure(points: Sequence[int] = POINTS, repeats: int = REPEATS) -> list[IterationTimes]:
    """Time our implementation and every installed peer, alternating iterations so that load affects all equally."""
    starts = {name: start for name, start in STARTS.items() if _installed(start)}
    return [one for count in points for one in _measured(starts, count, repeats)]


def _measured(starts: Mapping[str, Start], points: int, repeats: int) -> list[IterationTimes]:
    X, Y = cloud_and_nodes(points)
    setups: dict[str, list[float]] = {name: [] for name in starts}
    iterations: dict[str, list[float]] = {name: [] for name in starts}
    for _ in range(repeats):
        fits: dict[str, Iterate] = {}
        for name, start in starts.items():
            fits[name], taken_s = _timed(partial(start, X, Y))
            setups[name].append(taken_s)
        for _ in range(ITERATIONS):
            for name, iterate in fits.items():
                iterations[name].append(_timed(iterate)[1])
    return [
        IterationTimes(
            method=name, points=points, iterations_s=np.array(iterations[name]), setups_s=np.array(setups[name])
        )
        for name in starts
    ]


def figures(times: Sequence[IterationTimes]) -> list[BenchFigure]:
    """Rows of JSON: median time of an iteration, and its multiple of dlokit's; low and high contain 90 % of them."""
    rows: list[BenchFigure] = []
    for one in times:
        case = f"one iteration, {one.points} points"
        rows.append(
            _figure(case, one, "time an iteration", "s", *(one.quantile_s(fraction) for fraction in (0.5, 0.05, 0.95)))
        )
        rows.append(_figure(case, one, "time before the first", "s", float(np.median(one.setups_s))))
        if one.method != DLOKIT:
            rows.append(_figure(case, one, f"times {DLOKIT}'s", "", *ratio(one, _of(DLOKIT, one.points, times))))
    return rows


def ratio(peer: IterationTimes, ours: IterationTimes) -> tuple[float, float, float]:
    """A peer's iteration time over dlokit's: median, 5 % and 95 % over alternating pairs."""
    pairs = peer.iterations_s / ours.iterations_s
    return float(np.median(pairs)), float(np.quantile(pairs, 0.05)), float(np.quantile(pairs, 0.95))


def table(times: Sequence[IterationTimes]) -> Table:
    """The table of iteration times: one row per cloud size and method."""
    shown = Table(
        title=f"one CPD iteration, {NODES} nodes", caption="processor time: median (5 % to 95 % of iterations)"
    )
    shown.add_column("points", justify="right")
    shown.add_column("method")
    for name in ("µs an iteration", f"times {DLOKIT}'s", "µs before the first"):
        shown.add_column(name, justify="right", no_wrap=True)
    for one in times:
        middle, low, high = (1e6 * one.quantile_s(fraction) for fraction in (0.5, 0.05, 0.95))
        more, least, most = ratio(one, _of(DLOKIT, one.points, times))
        shown.add_row(
            str(one.points),
            one.method,
            f"{middle:.0f} ({low:.0f} to {high:.0f})",
            "1" if one.method == DLOKIT else f"{more:.0f} ({least:.0f} to {most:.0f})",
            f"{1e6 * float(np.median(one.setups_s)):.0f}",
        )
    return shown


def cloud_and_nodes(count: int) -> tuple[Float64Array, Float64Array]:
    """`count` points (N, 3) [m] of an S of 0.5 m with 2 mm noise and 5 % outliers, and 50 nodes 2 cm off it."""
    rng = np.random.default_rng(0)
    strays = count // 20
    points = _s_curve(rng.uniform(0.0, 1.0, count - strays)) + rng.normal(0.0, 0.002, (count - strays, 3))
    astray = rng.uniform([-0.1, -0.2, -0.1], [0.6, 0.2, 0.1], (strays, 3))
    nodes = _s_curve(np.linspace(0.0, 1.0, NODES)) + np.array([0.0, 0.02, 0.0])
    return rng.permutation(np.concatenate([points, astray])), nodes


def _s_curve(fraction: Float64Array) -> Float64Array:
    return np.column_stack([0.45 * fraction, 0.07 * np.sin(2.0 * np.pi * fraction), 0.0 * fraction])


def _start_dlokit(X: Float64Array, Y: Float64Array) -> Iterate:
    weights = Weights(lambda_per_m2=SETTINGS.lambda_per_m2)
    return MixtureFit(X, Y, SETTINGS, lambda iteration: weights).iterate


def _start_pycpd(X: Float64Array, Y: Float64Array) -> Iterate:
    registration = imported("pycpd").DeformableRegistration(
        X=X,
        Y=Y,
        alpha=SETTINGS.lambda_per_m2,
        beta=SETTINGS.beta_m,
        w=SETTINGS.outlier_weight,
        sigma2=SETTINGS.initial_sigma_m**2,
    )
    registration.transform_point_cloud()
    return registration.iterate


def _start_probreg(X: Float64Array, Y: Float64Array) -> Iterate:
    # The steps of its `registration`, which cannot be given a variance to start from.
    fit = imported("probreg.cpd").NonRigidCPD(Y, beta=SETTINGS.beta_m**2, lmd=SETTINGS.lambda_per_m2)
    state: dict[str, Any] = {"nodes": Y, "sigma2": SETTINGS.initial_sigma_m**2}

    def iterate() -> None:
        seen = fit.expectation_step(state["nodes"], X, state["sigma2"], 0.0, SETTINGS.outlier_weight)
        step = fit.maximization_step(X, seen, state["sigma2"])
        state.update(nodes=step.transformation.transform(Y), sigma2=step.sigma2)

    return iterate


STARTS: dict[str, Start] = {
    DLOKIT: _start_dlokit,
    "pycpd": _start_pycpd,
    "probreg": _start_probreg,
}
"""The start of a fit of each method; it returns a function for one iteration."""


def _installed(start: Start) -> bool:
    try:
        start(*cloud_and_nodes(NODES))()  # compiles and loads code at the first use
    except MachineError:
        return False
    return True


def _timed(work: Callable[[], Result]) -> tuple[Result, float]:
    began = time.process_time()
    done = work()
    return done, time.process_time() - began


def _of(method: str, points: int, times: Sequence[IterationTimes]) -> IterationTimes:
    return next(one for one in times if one.method == method and one.points == points)


def _figure(
    case: str,
    one: IterationTimes,
    metric: str,
    unit: str,
    value: float,
    low: float | None = None,
    high: float | None = None,
) -> BenchFigure:
    n = len(one.iterations_s)
    return BenchFigure(case=case, method=one.method, metric=metric, value=value, low=low, high=high, unit=unit, n=n)
