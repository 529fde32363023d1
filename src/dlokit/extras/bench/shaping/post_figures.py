"""Figures of runs among fixtures: sides of posts by estimate and truth, forces of the arm, and want of room."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.shaping.cases import CaseResult
from dlokit.extras.bench.statistics import success_rate, without_interval
from dlokit.skills.planning.component import AMONG_FIXTURES
from dlokit.system.results.run_result import RunResult
from dlokit.types.flow import RunOutcome
from dlokit.types.passing import AsWished, PostPassing

FIXTURES = "fixtures"
"""The case of these figures."""


@dataclass(frozen=True, kw_only=True)
class AmongFixtures:
    """The runs of one method among fixtures, counted."""

    method: str
    counts: tuple[tuple[str, int, int], ...]
    """What is counted, how many there are, and of how many."""
    largest_force_n: float
    """Largest force between an arm and a fixture in all runs [N]."""
    runs: int


def among_fixtures(results: Sequence[CaseResult]) -> Iterator[AmongFixtures]:
    """Count the runs of each method that had fixtures and a truth."""
    for method in dict.fromkeys(done.case.method.name for done in results):
        of_method = [done.result for done in results if done.case.method.name == method]
        forces = [(run, run.largest_fixture_force_n) for run in of_method if run.largest_fixture_force_n is not None]
        if forces:
            counts, most_n = _counts([run for run, _ in forces]), max(force_n for _, force_n in forces)
            yield AmongFixtures(method=method, counts=counts, largest_force_n=most_n, runs=len(forces))


def _counts(runs: Sequence[RunResult]) -> tuple[tuple[str, int, int], ...]:
    answers = [answer for run in runs for answer in _answers(run)]
    counted = {
        "converged with all sides right": [
            run.outcome is RunOutcome.CONVERGED
            and run.true_passing is not None
            and all(true for _, true in _answers(run))
            for run in runs
        ],
        "posts on the same side by estimate and truth": [same for run in runs for same in _same_sides(run)],
        "sides not seen": [seen is AsWished.NOT_SEEN for seen, _ in answers],
        "sides wrongly said right": [seen is AsWished.YES and not true for seen, true in answers],
        "runs without room for an action": [AMONG_FIXTURES in (run.reason or "") for run in runs],
    }
    return tuple((metric, sum(each), len(each)) for metric, each in counted.items())


def _same_sides(run: RunResult) -> list[bool]:
    """Whether estimate and truth say the same side of each post at the end."""
    if run.passing is None or run.true_passing is None:
        return []
    true = {one.name: one.side for one in run.true_passing.fixtures if isinstance(one, PostPassing)}
    seen = [one for one in run.passing.fixtures if isinstance(one, PostPassing)]
    return [one.side == true[one.name] for one in seen if one.name in true]


def _answers(run: RunResult) -> list[tuple[AsWished, bool]]:
    """The estimate's answer to each wished side, and whether it is truly as wished."""
    if run.passing is None or run.true_passing is None:
        return []
    true = {one.name: one.answer is AsWished.YES for one in run.true_passing.answers}
    return [(one.answer, true.get(one.name, False)) for one in run.passing.answers]


def fixture_figures(results: Sequence[CaseResult]) -> Iterator[BenchFigure]:
    """Rates and the largest force of each method; nothing without fixtures."""
    for one in among_fixtures(results):
        for metric, part, whole in one.counts:
            if whole:
                yield figure(FIXTURES, one.method, metric, success_rate(part, whole), "")
        most = without_interval(one.largest_force_n, one.runs)
        yield figure(FIXTURES, one.method, "max force between arm and fixture", most, "N")


def fixture_lines(results: Sequence[CaseResult]) -> Iterator[str]:
    """One line per method."""
    for one in among_fixtures(results):
        counts = ", ".join(f"{metric} {part} of {whole}" for metric, part, whole in one.counts)
        yield f"{one.method}: {counts}; largest force between arm and fixture {one.largest_force_n:.1f} N"
