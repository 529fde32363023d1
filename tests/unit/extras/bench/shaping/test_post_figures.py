"""The figures of runs among fixtures, from results of runs."""

import msgspec
import pytest
from shaping_results import FARTHEST, ROLLOUT, done, run

from dlokit.extras.bench.shaping.figures import figures
from dlokit.extras.bench.shaping.post_figures import FIXTURES, fixture_lines
from dlokit.system.results.run_result import RunResult
from dlokit.types.flow import RunOutcome
from dlokit.types.passing import AsWished, Passing, PostPassing, SideAnswer

REACHED = run([0.05, 0.010])
YES, NO, NOT_SEEN = AsWished.YES, AsWished.NO, AsWished.NOT_SEEN


def passed(sides: tuple[int, ...], answers: tuple[AsWished, ...]) -> Passing:
    """A passing of posts A, B, … with answers to the first of them."""
    posts = [
        PostPassing(name=name, side=side, winding_rad=0.0, along_m=0.0, distance_m=0.0)
        for name, side in zip("ABC", sides, strict=False)
    ]
    wished = [
        SideAnswer(name=name, turn=1, answer=answer, margin_m=0.0) for name, answer in zip("ABC", answers, strict=False)
    ]
    return Passing(fixtures=tuple(posts), answers=tuple(wished))


def among(
    seen: Passing | None, true: Passing | None, force_n: float = 0.0, outcome: RunOutcome = RunOutcome.CONVERGED
) -> RunResult:
    return msgspec.structs.replace(
        REACHED, outcome=outcome, passing=seen, true_passing=true, largest_fixture_force_n=force_n
    )


RIGHT = passed((1, 1), (YES, YES))
RUNS = [
    among(RIGHT, RIGHT),
    among(RIGHT, passed((1, -1), (YES, NO)), force_n=0.25),
    among(passed((1, 0), (YES, NOT_SEEN)), RIGHT, outcome=RunOutcome.STALLED),
    # B is missing in the cell: its side is not truly right, and there is no side to compare.
    among(RIGHT, passed((1,), (YES,))),
    msgspec.structs.replace(
        among(None, None, outcome=RunOutcome.STALLED), reason="no node is left; among the fixtures the hand has no room"
    ),
    # The cell ended before the DLO rested: nothing says that its sides are right.
    among(RIGHT, None),
]
COUNTS = {
    "converged with all sides right": (1, 6),
    "posts on the same side by estimate and truth": (5, 7),
    "sides not seen": (1, 8),
    "sides wrongly said right": (2, 8),
    "runs without room for an action": (1, 6),
}


def test_runs_sides_and_forces_are_counted_for_each_method() -> None:
    results = [done(one, seed=seed) for seed, one in enumerate(RUNS)] + [done(RUNS[0], method=ROLLOUT)]
    rows = [row for row in figures(results) if row.case == FIXTURES]
    found = {row.metric: (row.value, row.n) for row in rows if row.method == FARTHEST.name}
    assert found.pop("max force between arm and fixture") == (0.25, 6)
    assert found == {metric: (pytest.approx(part / whole), whole) for metric, (part, whole) in COUNTS.items()}
    assert {row.value for row in rows if row.method == ROLLOUT.name} == {1.0, 0.0}

    first, second = fixture_lines(results)
    assert first.startswith(f"{FARTHEST.name}: converged with all sides right 1 of 6, ")
    assert first.endswith("; largest force between arm and fixture 0.2 N")
    assert second.startswith(f"{ROLLOUT.name}: converged with all sides right 1 of 1, ")


def test_runs_without_fixtures_have_no_figures_of_them() -> None:
    results = [done(REACHED)]
    assert not [row for row in figures(results) if row.case == FIXTURES]
    assert list(fixture_lines(results)) == []
