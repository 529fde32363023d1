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

    runs: int
    right: int
    """Runs that converged with all sides truly as wished."""
    posts: int
    """Posts at the ends of all runs."""
    agreeing: int
    """Posts that estimate and truth pass on the same side."""
    answers: int
    """Wished sides."""
    not_seen: int
    """Wished sides of which the estimate says that they are not seen."""
    false_yes: int
    """Wished sides of which the estimate says yes and the truth no."""
    no_room: int
    """Runs that ended because the arm had no room for an action."""
    largest_force_n: float
    """Largest force between an arm and a fixture in all runs [N]."""


def among_fixtures(runs: Sequence[RunResult]) -> AmongFixtures | None:
    """Count the runs that had fixtures and a truth; None without any."""
    runs = [run for run in runs if run.largest_fixture_force_n is not None]
    if not runs:
        return None
    pairs = [pair for run in runs for pair in _posts(run)]
    answers = [answer for run in runs for answer in _answers(run)]
    return AmongFixtures(
        runs=len(runs),
        right=sum(run.outcome is RunOutcome.CONVERGED and all(true for _, true in _answers(run)) for run in runs),
        posts=len(pairs),
        agreeing=sum(seen.side == true.side for seen, true in pairs),
        answers=len(answers),
        not_seen=sum(seen is AsWished.NOT_SEEN for seen, _ in answers),
        false_yes=sum(seen is AsWished.YES and not true for seen, true in answers),
        no_room=sum(AMONG_FIXTURES in (run.reason or "") for run in runs),
        largest_force_n=max(run.largest_fixture_force_n or 0.0 for run in runs),
    )


def _posts(run: RunResult) -> list[tuple[PostPassing, PostPassing]]:
    """How the DLO passes each post at the end, by estimate and by truth."""
    if run.passing is None or run.true_passing is None:
        return []
    true = {one.name: one for one in run.true_passing.fixtures if isinstance(one, PostPassing)}
    return [(one, true[one.name]) for one in run.passing.fixtures if isinstance(one, PostPassing) and one.name in true]


def _answers(run: RunResult) -> list[tuple[AsWished, bool]]:
    """The estimate's answer to each wished side, and whether it is truly as wished."""
    if run.passing is None or run.true_passing is None:
        return []
    true = {one.name: one.answer is AsWished.YES for one in run.true_passing.answers}
    return [(one.answer, true.get(one.name, False)) for one in run.passing.answers]


def fixture_figures(results: Sequence[CaseResult]) -> Iterator[BenchFigure]:
    """Rates and the largest force of each method; nothing without fixtures."""
    for method, count in _by_method(results):
        rates = (
            ("converged with all sides right", count.right, count.runs),
            ("posts on the same side by estimate and truth", count.agreeing, count.posts),
            ("sides not seen", count.not_seen, count.answers),
            ("sides wrongly said right", count.false_yes, count.answers),
            ("runs without room for an action", count.no_room, count.runs),
        )
        for metric, part, whole in rates:
            if whole:
                yield figure(FIXTURES, method, metric, success_rate(part, whole), "")
        most = without_interval(count.largest_force_n, count.runs)
        yield figure(FIXTURES, method, "max force between arm and fixture", most, "N")


def fixture_lines(results: Sequence[CaseResult]) -> Iterator[str]:
    """One line per method."""
    for method, count in _by_method(results):
        yield (
            f"{method}: {count.right} of {count.runs} converged with all sides right; estimate and truth agree at "
            f"{count.agreeing} of {count.posts} posts, {count.not_seen} of {count.answers} sides not seen, "
            f"{count.false_yes} wrongly said right; {count.no_room} runs without room for an action; largest force "
            f"between arm and fixture {count.largest_force_n:.1f} N"
        )


def _by_method(results: Sequence[CaseResult]) -> Iterator[tuple[str, AmongFixtures]]:
    for method in dict.fromkeys(done.case.method.name for done in results):
        count = among_fixtures([done.result for done in results if done.case.method.name == method])
        if count is not None:
            yield method, count
