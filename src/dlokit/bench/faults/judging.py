"""What was found out about runs that something happened to, whether it was right, and figures of a sweep of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from dlokit.bench.faults.table import Ending, Fault
from dlokit.bench.report import BenchFigure, figure
from dlokit.bench.shaping.metrics import FALSE_BEYOND_M
from dlokit.evaluation.statistics import Interval, median, success_rate, without_interval
from dlokit.types.flow import RunOutcome

BRAKES_WITHIN_S = 0.25
"""An arm whose commander is lost begins to brake within this."""
LOST_S = 1.0
"""A recording whose writer was killed lacks at most the last of this."""


class RunFinding(msgspec.Struct, frozen=True, kw_only=True):
    """One run, as found from outside: its files, its exit code, the bus, the table of processes."""

    fault: str
    number: int
    """Of the fault's runs, from 0."""
    struck: bool = False
    """Whether the fault came before the run had ended."""
    skipped: str = ""
    """Why this machine cannot do such a fault; such a run is neither right nor wrong."""
    broken: str = ""
    """What went wrong with the bench itself, e.g. a run that never started."""
    moment: str = ""
    step: str = ""
    """Box of the flow in which it came."""
    struck_ns: int | None = None
    """When it came, on the run's clock [ns]."""
    exit_code: int | None = None
    """Of the run's process; None: it did not end, and was killed by the bench."""
    outcome: RunOutcome | None = None
    """As in `result.json`, of the run that goes on where one does; None: there is none."""
    reason: str = ""
    actions: int | None = None
    rmse_m: float | None = None
    true_rmse_m: float | None = None
    threshold_m: float | None = None
    moved: bool = False
    """Whether the arm moved when the fault came, and did not come to the end of its motion by itself."""
    braked_s: float | None = None
    """From the fault until the arm is heard to brake [s]; None: it did not, or need not."""
    stands: bool | None = None
    """Whether the arm stood when it was heard last; None: it is gone with its cell."""
    recovered_after_s: float | None = None
    """From the fault until the flow goes on [s]; 0 where it never stopped; None: it did not go on."""
    restarts: dict[str, int] = {}
    readable: bool = False
    """Whether the recording can be read."""
    whole: bool = False
    """Whether it was written to its end."""
    lost_s: float | None = None
    """What a recording lacks before the fault that ended it [s of the run's clock]; None: it was not ended so."""
    lost_messages: int | None = None
    """Messages that a whole recording lacks, by their numbers."""
    remaining_processes: tuple[str, ...] = ()
    """Processes that were there long after the run's end."""
    wall_s: float = 0.0


def faults_of(finding: RunFinding, fault: Fault) -> tuple[str, ...]:
    """What is wrong with a run, in words; empty when it ended as it should."""
    wrong: list[str] = []
    if finding.exit_code is None:
        wrong.append("it did not end")
    if not ends_right(finding, fault.right):
        asked = " or ".join(map(str, fault.right))
        wrong.append(f"it ended as {_ending(finding)} instead of {asked}")
    if fault.brakes and finding.moved and finding.braked_s is None:
        wrong.append("the arm did not brake")
    if finding.stands is False:
        wrong.append("the arm did not stand at the end")
    if finding.remaining_processes:
        wrong.append(f"{len(finding.remaining_processes)} processes were left behind")
    if falsely_converged(finding):
        wrong.append("it converged falsely")
    if not finding.readable:
        wrong.append("its recording cannot be read")
    if finding.lost_s is not None and finding.lost_s > LOST_S:
        wrong.append(f"its recording lacks {finding.lost_s:.1f} s")
    return tuple(wrong)


def ends_right(finding: RunFinding, right: Sequence[Ending]) -> bool:
    """Whether a run ended in one of the right ways; a failure must have a name."""
    return any(
        finding.outcome is ending.outcome and (finding.reason or "").startswith(ending.reason) for ending in right
    )


def falsely_converged(finding: RunFinding) -> bool:
    """Whether a run says that it converged, and the truth is beyond the threshold and a margin."""
    if finding.outcome is not RunOutcome.CONVERGED or finding.true_rmse_m is None or finding.threshold_m is None:
        return False
    return finding.true_rmse_m > finding.threshold_m + FALSE_BEYOND_M


def _ending(finding: RunFinding) -> str:
    if finding.outcome is None:
        return f"exit code {finding.exit_code} without a result"
    return f"{finding.outcome.value}, {finding.reason}" if finding.reason else finding.outcome.value


ALL = "all"
CONTROL = "none"


@dataclass(frozen=True)
class FaultRow:
    """The runs of one fault, or of all but the control."""

    name: str
    judged: tuple[tuple[RunFinding, tuple[str, ...]], ...]
    """Each run that was struck, with what was wrong with it."""
    others: tuple[RunFinding, ...]
    """Runs that were not: skipped, broken, or done before the fault came."""

    @property
    def findings(self) -> list[RunFinding]:
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

    def values(self, of: Callable[[RunFinding], float | None]) -> list[float]:
        """One figure of each run that has it."""
        return [value for finding in self.findings if (value := of(finding)) is not None]


def fault_rows(results: Sequence[tuple[Fault, RunFinding]]) -> list[FaultRow]:
    """A row a fault, and one of all but the control."""
    names = dict.fromkeys(fault.name for fault, _ in results)
    rows = [_row(name, [pair for pair in results if pair[0].name == name]) for name in names]
    return [*rows, _row(ALL, [pair for pair in results if pair[0].name != CONTROL])]


def _row(name: str, results: Sequence[tuple[Fault, RunFinding]]) -> FaultRow:
    struck = [(finding, faults_of(finding, fault)) for fault, finding in results if finding.struck]
    return FaultRow(name, tuple(struck), tuple(finding for _, finding in results if not finding.struck))


def all_right(results: Sequence[tuple[Fault, RunFinding]]) -> bool:
    """Whether every run that was struck ended as it should, and none broke down."""
    return not any(finding.broken or (finding.struck and faults_of(finding, fault)) for fault, finding in results)


def recovered_s(finding: RunFinding) -> float | None:
    """From the fault until the flow went on [s], of a run that reached its goal."""
    return finding.recovered_after_s if finding.outcome is RunOutcome.CONVERGED else None


VALUES: tuple[tuple[str, Callable[[RunFinding], float | None], str], ...] = (
    ("time to recover", recovered_s, "s"),
    ("braking begins after", lambda finding: finding.braked_s, "s"),
    ("recording lacks", lambda finding: finding.lost_s, "s"),
    ("true RMSE", lambda finding: finding.true_rmse_m, "m"),
)


def figures(results: Sequence[tuple[Fault, RunFinding]]) -> list[BenchFigure]:
    """Rows of the JSON file."""
    return [one for row in fault_rows(results) for one in _figures(row)]


def _figures(row: FaultRow) -> Iterator[BenchFigure]:
    yield _figure(row, "runs not struck", without_interval(float(len(row.others)), len(row.others)), "1")
    if not row.judged:
        return
    n = len(row.judged)
    yield _figure(row, "ended as it should", success_rate(row.right, n), "1")
    converged = sum(finding.outcome is RunOutcome.CONVERGED for finding in row.findings)
    yield _figure(row, "converged", success_rate(converged, n), "1")
    left = float(sum(len(finding.remaining_processes) for finding in row.findings))
    yield _figure(row, "processes left behind", without_interval(left, n), "1")
    for name, value, unit in VALUES:
        values = row.values(value)
        if values:
            yield _figure(row, f"median {name}", median(values), unit)
            yield _figure(row, f"max {name}", without_interval(max(values), len(values)), unit)


def _figure(row: FaultRow, metric: str, interval: Interval, unit: str) -> BenchFigure:
    return figure(row.name, "dlokit", metric, interval, unit)
