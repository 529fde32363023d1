"""Which runs make a row: an experiment, a group of them, all of one verdict, all."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dlokit.bench.shaping.cases import CaseResult
from dlokit.bench.shaping.metrics import standing
from dlokit.system.results.run_result import RunResult
from dlokit.types.feasibility import Standing

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class Row:
    """The runs of one method that a figure is of."""

    name: str
    method: str
    results: tuple[CaseResult, ...]

    @property
    def runs(self) -> list[RunResult]:
        """What became of each."""
        return [done.result for done in self.results]


def experiment_rows(results: Sequence[CaseResult]) -> Iterator[Row]:
    """A row an experiment and method."""
    for name in dict.fromkeys(done.case.experiment.name for done in results):
        yield from _rows(name, [done for done in results if done.case.experiment.name == name])


def group_rows(results: Sequence[CaseResult]) -> Iterator[Row]:
    """Rows of the suite's groups, of each verdict that was given, and of everything."""
    for group in dict.fromkeys(group for done in results for group in done.case.experiment.groups):
        yield from _rows(group, [done for done in results if group in done.case.experiment.groups])
    for verdict in Standing:
        yield from _rows(verdict_row(verdict), [done for done in results if standing(done.result) is verdict])
    yield from _rows(ALL, results)


def verdict_row(verdict: Standing) -> str:
    """The name of the row of all runs with that verdict."""
    return f"verdict {verdict.value}"


def _rows(name: str, results: Sequence[CaseResult]) -> Iterator[Row]:
    for method in dict.fromkeys(done.case.method.name for done in results):
        yield Row(name=name, method=method, results=tuple(done for done in results if done.case.method.name == method))
