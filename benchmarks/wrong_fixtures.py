"""What whole tasks do where a fixture does not stand as believed: named before an action, and no force on it.

    python benchmarks/wrong_fixtures.py --seeds 20

The drawn scenes of `dlokit bench shaping --suite posts`, with every second post larger. In the cell one post is moved
by 15 mm, two are exchanged, one is missing, or one stands there that is not believed. `fixtures_seen.py` measures how
often a look misses such a change, or names a fixture that stands as believed.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit.description.clearance import clear_of
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.scene import Fixture
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.shaping.cases import CaseResult, ShapingCase, ShapingMethod
from dlokit.extras.bench.shaping.post_figures import among_fixtures
from dlokit.extras.bench.shaping.runner import attempt_case
from dlokit.extras.bench.shaping.suites import posts_suite
from dlokit.extras.bench.statistics import success_rate, without_interval
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig
from dlokit.system.config import RunConfig
from dlokit.types.flow import RunOutcome
from fixtures_seen import SIZES_M, change
from parts.command import check_json, run_study, seeds_of, write_figures

CASES = ("moved by 15 mm", "exchanged", "missing", "unknown")
METHOD = ShapingMethod(observer="map", planner="rollout")


@dataclass(frozen=True, kw_only=True)
class Args:
    """Run tasks in scenes of which the system believes something wrong, and count what is named."""

    seeds: int = 20
    """Tasks of each case, with seeds from `first_seed` on."""
    first_seed: int = 500
    """First seed."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    seeds = seeds_of(args.seeds, args.first_seed)
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    rows: list[BenchFigure] = []
    for case in CASES:
        results = [_task(case, seed) for seed in seeds]
        named = [_is_named(done) for done in results]
        (counted,) = among_fixtures(results)
        others = [done.result.outcome.value for done, is_named in zip(results, named, strict=True) if not is_named]
        false_yes = next(count for metric, count, _ in counted.counts if metric == "sides wrongly said right")
        console.print(
            f"{case:16} named before an action in {sum(named)} of {args.seeds} tasks"
            f"{', the others: ' + ', '.join(others) if others else ''}; sides wrongly said right {false_yes}; largest "
            f"force between arm and fixture {counted.largest_force_n:.1f} N"
        )
        rows.append(figure(case, METHOD.name, "named before an action", success_rate(sum(named), args.seeds), ""))
        force = without_interval(counted.largest_force_n, args.seeds)
        rows.append(figure(case, METHOD.name, "max force between arm and fixture", force, "N"))
    write_figures(args.json, "wrong fixtures", rows, {"seeds": args.seeds, "first_seed": args.first_seed}, console)
    return 0


def _is_named(done: CaseResult) -> bool:
    result = done.result
    return (
        result.outcome is RunOutcome.INFEASIBLE and not result.actions and (result.reason or "").startswith("fixtures:")
    )


def _task(case: str, seed: int) -> CaseResult:
    (drawn, *_) = (one for one in posts_suite() if one.drawn)
    experiment, rng = drawn.of_seed(seed + drawn.seed_offset), np.random.default_rng([seed, 0xF2])
    start = experiment.start_world(SOFT_ROPE, seed + drawn.seed_offset)
    sized = tuple(_sized(post, number) for number, post in enumerate(experiment.fixtures))
    believed, true, _ = change(case, sized, rng)
    while not clear_of(start, true, SOFT_ROPE.radius_m):  # the cell puts nothing into the DLO
        believed, true, _ = change(case, sized, rng)
    config = RunConfig(headless=True, cell=CellConfig(randomised=EVERY_FACTOR, fixtures=true))
    shaping = ShapingCase(experiment=replace(experiment, fixtures=believed), seed=seed, method=METHOD)
    with tempfile.TemporaryDirectory() as folder:
        return attempt_case(shaping, config, Path(folder) / "run")


def _sized(fixture: Fixture, number: int) -> Fixture:
    diameter_m, height_m = SIZES_M[number % 2]
    return replace(fixture, diameter_m=diameter_m, height_m=height_m)


if __name__ == "__main__":
    run_study(Args, run, __doc__)
