"""Findings about runs with a fault, their verdicts, and the figures of a sweep."""

from collections.abc import Callable, Iterator, Sequence

import msgspec

from dlokit.errors import EXIT_FAULT
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.shaping.metrics import FALSE_MARGIN_M
from dlokit.extras.bench.statistics import median, success_rate, without_interval
from dlokit.types.flow import RunOutcome
from parts.faults.table import Ending, Fault

BRAKES_WITHIN_S = 0.25
"""Limit on the time until an arm that has lost its commander begins to brake [s]."""
NAMED_WITHIN_S = 2.0
"""Limit on the time until a camera that gives no pictures is named [s]."""
LOST_S = 1.0
"""Limit on the loss at the end of a recording whose writer was killed [s]."""


class RunFinding(msgspec.Struct, frozen=True, kw_only=True):
    """One run as observed from outside: by its files, its exit code, the bus, and the process table."""

    fault: str
    number: int
    """Number among the runs of the fault, from 0."""
    struck: bool = False
    """Whether the fault was injected before the run had ended."""
    skipped: str = ""
    """Why this machine cannot inject the fault; such a run is not judged."""
    broken: str = ""
    """An error of the bench itself, e.g. a run that never started."""
    moment: str = ""
    step: str = ""
    """Step of the flow in which the fault was injected."""
    struck_ns: int | None = None
    """Time of the fault, on the run's clock [ns]."""
    exit_code: int | None = None
    """Exit code of the run's process; None: it did not end, and the bench killed it."""
    outcome: RunOutcome | None = None
    """As in `result.json`, of the resumed run if there is one; without that file as printed; None: there is none."""
    reason: str = ""
    rmse_m: float | None = None
    true_rmse_m: float | None = None
    threshold_m: float | None = None
    moved: bool = False
    """Whether the arm was moving at the fault, and did not complete its motion."""
    braked_s: float | None = None
    """Time from the fault until the arm reports that it brakes [s]; None: it did not, or need not."""
    stands: bool | None = None
    """Whether the arm was at rest in its last report; None: it has died with its cell."""
    recovered_after_s: float | None = None
    """Time from the fault until the flow continues [s]; 0 if it never stopped; None: it did not continue."""
    named_s: float | None = None
    """Time from the first picture that did not come until the flow named the fault [s]; None: it did not."""
    readable: bool = False
    """Whether the recording can be read."""
    lost_s: float | None = None
    """Loss of a recording before the fault that ended it [s of the run's clock]; None: no fault ended it."""
    remaining_processes: tuple[str, ...] = ()
    """Processes that still existed long after the run's end."""
    incomplete: bool = False
    """Whether the run printed that files are missing."""
    traceback: bool = False
    """Whether the run printed a traceback."""
    wall_s: float = 0.0


def faults_of(finding: RunFinding, fault: Fault) -> tuple[str, ...]:
    """The defects of a run, in words; empty when it ended as required."""
    wrong: list[str] = []
    if finding.exit_code is None:
        wrong.append("it did not end")
    if not ends_right(finding, fault.right):
        asked = " or ".join(map(str, fault.right))
        wrong.append(f"it ended as {_ending(finding)} instead of {asked}")
    if fault.brakes and finding.moved and finding.braked_s is None:
        wrong.append("the arm did not brake")
    if fault.named and finding.named_s is None:
        wrong.append(f"{fault.named} was not named")
    if finding.named_s is not None and finding.named_s > NAMED_WITHIN_S:
        wrong.append(f"{fault.named} was named after {finding.named_s:.1f} s")
    if finding.stands is False:
        wrong.append("the arm was not at rest at the end")
    if finding.remaining_processes:
        wrong.append(f"{len(finding.remaining_processes)} processes remained")
    if falsely_converged(finding):
        wrong.append(
            f"it converged falsely: {_mm(finding.rmse_m)} by its estimate, {_mm(finding.true_rmse_m)} in truth"
        )
    if fault.disk:
        if finding.exit_code != EXIT_FAULT:
            wrong.append(f"its exit code is {finding.exit_code} instead of {EXIT_FAULT}")
        if not finding.incomplete:
            wrong.append("it did not say which files are missing")
        if finding.traceback:
            wrong.append("it printed a traceback")
    elif not finding.readable:
        wrong.append("its recording cannot be read")
    if finding.lost_s is not None and finding.lost_s > LOST_S:
        wrong.append(f"its recording lacks {finding.lost_s:.1f} s")
    return tuple(wrong)


def ends_right(finding: RunFinding, right: Sequence[Ending]) -> bool:
    """Whether a run ended in one of the allowed ways; a failure must have a name."""
    return any(
        finding.outcome is ending.outcome and (finding.reason or "").startswith(ending.reason) for ending in right
    )


def falsely_converged(finding: RunFinding) -> bool:
    """Whether a run reports convergence, and the true error exceeds the threshold by more than a margin."""
    if finding.outcome is not RunOutcome.CONVERGED or finding.true_rmse_m is None or finding.threshold_m is None:
        return False
    return finding.true_rmse_m > finding.threshold_m + FALSE_MARGIN_M


def _mm(error_m: float | None) -> str:
    return "unknown" if error_m is None else f"{1e3 * error_m:.1f} mm"


def _ending(finding: RunFinding) -> str:
    if finding.outcome is None:
        return f"exit code {finding.exit_code} without a result"
    return f"{finding.outcome.value}, {finding.reason}" if finding.reason else finding.outcome.value


ALL = "all"
CONTROL = "none"


def all_right(results: Sequence[tuple[Fault, RunFinding]]) -> bool:
    """Whether every run with a fault ended as required, and none failed."""
    return not any(finding.broken or (finding.struck and faults_of(finding, fault)) for fault, finding in results)


def _recovered_s(finding: RunFinding) -> float | None:
    """Of a run that reached its goal."""
    return finding.recovered_after_s if finding.outcome is RunOutcome.CONVERGED else None


VALUES: tuple[tuple[str, Callable[[RunFinding], float | None], str], ...] = (
    ("time to recover", _recovered_s, "s"),
    ("braking begins after", lambda finding: finding.braked_s, "s"),
    ("named after", lambda finding: finding.named_s, "s"),
    ("recording lacks", lambda finding: finding.lost_s, "s"),
    ("true RMSE", lambda finding: finding.true_rmse_m, "m"),
)


def figures(results: Sequence[tuple[Fault, RunFinding]]) -> list[BenchFigure]:
    """Those of each fault, and of all faults except the control."""
    names = dict.fromkeys(fault.name for fault, _ in results)
    rows = {name: [pair for pair in results if pair[0].name == name] for name in names}
    rows[ALL] = [pair for pair in results if pair[0].name != CONTROL]
    return [one for name, row in rows.items() for one in _figures(name, row)]


def _figures(name: str, results: Sequence[tuple[Fault, RunFinding]]) -> Iterator[BenchFigure]:
    """Runs without their fault, skipped, failed, or completed before the injection, are counted and not judged."""
    struck = [(fault, finding) for fault, finding in results if finding.struck]
    findings, n, others = [finding for _, finding in struck], len(struck), len(results) - len(struck)
    yield figure(name, "dlokit", "runs not struck", without_interval(float(others), others), "1")
    if not struck:
        return
    right = sum(not faults_of(finding, fault) for fault, finding in struck)
    yield figure(name, "dlokit", "ended as it should", success_rate(right, n), "1")
    converged = sum(finding.outcome is RunOutcome.CONVERGED for finding in findings)
    yield figure(name, "dlokit", "converged", success_rate(converged, n), "1")
    left = float(sum(len(finding.remaining_processes) for finding in findings))
    yield figure(name, "dlokit", "processes left behind", without_interval(left, n), "1")
    for what, value, unit in VALUES:
        values = [found for finding in findings if (found := value(finding)) is not None]
        if values:
            yield figure(name, "dlokit", f"median {what}", median(values), unit)
            yield figure(name, "dlokit", f"max {what}", without_interval(max(values), len(values)), unit)
