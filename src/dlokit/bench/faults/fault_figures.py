"""Figures of a sweep of faults: how many ended as they should, and what it cost."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from dlokit.bench.faults.judging import Finding, faults_of
from dlokit.bench.faults.table import Fault
from dlokit.bench.report import Figure, figure
from dlokit.evaluation.statistics import Interval, median, success_rate, without_interval
from dlokit.types.flow import RunOutcome

ALL = "all"
CONTROL = "none"


@dataclass(frozen=True)
class Row:
    """The runs of one fault, or of all but the control."""

    name: str
    judged: tuple[tuple[Finding, tuple[str, ...]], ...]
    """Each run that was struck, with what was wrong with it."""
    others: tuple[Finding, ...]
    """Runs that were not: skipped, broken, or done before the fault came."""

    @property
    def findings(self) -> list[Finding]:
        """What was found of each run that was struck."""
        return [finding for finding, _ in self.judged]

    @property
    def right(self) -> int:
        """How many ended as they should."""
        return sum(not wrong for _, wrong in self.judged)

    @property
    def rate(self) -> Interval | None:
        """The part that ended as it should, with its Clopper-Pearson interval; None without runs."""
        return success_rate(self.right, len(self.judged)) if self.judged else None

    def values(self, of: Callable[[Finding], float | None]) -> list[float]:
        """One figure of each run that has it."""
        return [value for finding in self.findings if (value := of(finding)) is not None]


def fault_rows(results: Sequence[tuple[Fault, Finding]]) -> list[Row]:
    """A row a fault, and one of all but the control."""
    names = dict.fromkeys(fault.name for fault, _ in results)
    rows = [_row(name, [pair for pair in results if pair[0].name == name]) for name in names]
    return [*rows, _row(ALL, [pair for pair in results if pair[0].name != CONTROL])]


def _row(name: str, results: Sequence[tuple[Fault, Finding]]) -> Row:
    struck = [(finding, faults_of(finding, fault)) for fault, finding in results if finding.struck]
    return Row(name, tuple(struck), tuple(finding for _, finding in results if not finding.struck))


def all_right(results: Sequence[tuple[Fault, Finding]]) -> bool:
    """Whether every run that was struck ended as it should, and none broke down."""
    return not any(finding.broken or (finding.struck and faults_of(finding, fault)) for fault, finding in results)


def recovered_s(finding: Finding) -> float | None:
    """From the fault until the flow went on [s], of a run that reached its goal."""
    return finding.mended_s if finding.outcome is RunOutcome.CONVERGED else None


VALUES: tuple[tuple[str, Callable[[Finding], float | None], str], ...] = (
    ("time to recover", recovered_s, "s"),
    ("braking begins after", lambda finding: finding.braked_s, "s"),
    ("recording lacks", lambda finding: finding.lost_s, "s"),
    ("true RMSE", lambda finding: finding.true_rmse_m, "m"),
)


def figures(results: Sequence[tuple[Fault, Finding]]) -> list[Figure]:
    """Rows of the JSON file."""
    return [one for row in fault_rows(results) for one in _figures(row)]


def _figures(row: Row) -> Iterator[Figure]:
    yield _figure(row, "runs not struck", without_interval(float(len(row.others)), len(row.others)), "1")
    if not row.judged:
        return
    n = len(row.judged)
    yield _figure(row, "ended as it should", success_rate(row.right, n), "1")
    converged = sum(finding.outcome is RunOutcome.CONVERGED for finding in row.findings)
    yield _figure(row, "converged", success_rate(converged, n), "1")
    left = float(sum(len(finding.left_behind) for finding in row.findings))
    yield _figure(row, "processes left behind", without_interval(left, n), "1")
    for name, value, unit in VALUES:
        values = row.values(value)
        if values:
            yield _figure(row, f"median {name}", median(values), unit)
            yield _figure(row, f"max {name}", without_interval(max(values), len(values)), unit)


def _figure(row: Row, metric: str, interval: Interval, unit: str) -> Figure:
    return figure(row.name, "dlokit", metric, interval, unit)
