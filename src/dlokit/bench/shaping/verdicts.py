"""Verdicts on goals against what happened."""

from collections.abc import Iterator, Sequence

from dlokit.bench.report import Figure, figure
from dlokit.bench.shaping.cases import CaseResult
from dlokit.bench.shaping.metrics import reached, standing
from dlokit.evaluation.statistics import success_rate
from dlokit.types.feasibility import Standing

VERDICTS = "verdicts"
"""The case of these figures."""
ANY = "any"
"""The method of those that all methods make together."""


def confusion(results: Sequence[CaseResult]) -> dict[Standing, tuple[int, int]]:
    """Runs that reached the goal, and all runs, by what was said of it."""
    counts: dict[Standing, tuple[int, int]] = {}
    for verdict in Standing:
        said = [done.result for done in results if standing(done.result) is verdict]
        counts[verdict] = (sum(map(reached, said)), len(said))
    return counts


def goals_refuted(results: Sequence[CaseResult]) -> tuple[int, int]:
    """Goals that were called infeasible in a cell where a run reached them, by whatever method; and all such goals.

    A goal in the cell of another seed is another goal: what holds depends on friction and stiffness.
    """
    infeasible = {_goal(done) for done in results if standing(done.result) is Standing.INFEASIBLE}
    reached_goals = {_goal(done) for done in results if reached(done.result)}
    return len(infeasible & reached_goals), len(infeasible)


def kept(results: Sequence[CaseResult]) -> dict[Standing, tuple[int, int]]:
    """Experiments by what is said of their goal in the first run of each, of all experiments that were judged."""
    first: dict[str, Standing] = {}
    for done in results:
        said = standing(done.result)
        if said is not None:
            first.setdefault(done.case.experiment.name, said)
    return {verdict: (sum(said is verdict for said in first.values()), len(first)) for verdict in Standing}


def verdict_figures(results: Sequence[CaseResult]) -> Iterator[Figure]:
    """How often a goal that is said to hold is reached; how many goals are kept; what was wrongly refused."""
    for method in dict.fromkeys(done.case.method.name for done in results):
        of_method = [done for done in results if done.case.method.name == method]
        for verdict, (wins, runs) in confusion(of_method).items():
            if runs:
                yield _rate(method, f"reached, said {verdict.value}", wins, runs)
    refuted, infeasible = goals_refuted(results)
    if infeasible:
        yield _rate(ANY, "infeasible goals that a run reached", refuted, infeasible)
    for verdict, (count, goals) in kept(results).items():
        if goals:
            yield _rate(ANY, f"goals said {verdict.value}", count, goals)


def _goal(done: CaseResult) -> tuple[str, int]:
    return done.case.experiment.name, done.case.seed


def _rate(method: str, metric: str, count: int, n: int) -> Figure:
    return figure(VERDICTS, method, metric, success_rate(count, n), "")
