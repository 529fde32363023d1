"""How `dlokit bench faults` prints what it has found."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from dlokit.bench.faults.fault_figures import Row, recovered_s
from dlokit.bench.faults.judging import BRAKES_WITHIN_S, Finding, faults_of
from dlokit.bench.faults.trial import Case
from dlokit.types.flow import RunOutcome


def line_of(case: Case, finding: Finding) -> str:
    """One run in one line."""
    head = f"{case.folder_name}: "
    if finding.skipped:
        return f"{head}skipped: {finding.skipped}"
    if finding.broken:
        return f"{head}BROKEN: {finding.broken.splitlines()[0]}"
    if not finding.struck:
        return f"{head}the task was done before the fault came, each time"
    wrong = faults_of(finding, case.fault)
    ended = "no result" if finding.outcome is None else finding.outcome.value
    said = [f"in {finding.step}", ended]
    if finding.reason:
        said.append(finding.reason.splitlines()[0][:80])
    if finding.true_rmse_m is not None:
        said.append(f"true {finding.true_rmse_m * 1e3:.1f} mm")
    if finding.braked_s is not None:
        said.append(f"braked after {finding.braked_s * 1e3:.0f} ms")
    if finding.mended_s and recovered_s(finding) is not None:
        said.append(f"went on after {finding.mended_s:.0f} s")
    if finding.lost_s is not None:
        said.append(f"recording lacks {finding.lost_s:.2f} s")
    verdict = "as it should" if not wrong else f"WRONG: {'; '.join(wrong)}"
    return f"{head}{', '.join(said)} ({finding.wall_s:.0f} s) {verdict}"


def faults_table(rows: Sequence[Row]) -> Table:
    """One row a fault."""
    caption = f"braking must begin within {BRAKES_WITHIN_S * 1e3:.0f} ms; times: median, max"
    # Without lines between the columns it fits into a terminal of 80.
    table = Table(title="faults", caption=caption, box=None, padding=(0, 1, 0, 0))
    headings = ("fault", "runs", "right", "at\nleast", "con-\nverged", "recovers\ns", "brakes\nms", "lost\ns", "left")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "fault" else "right", no_wrap=True)
    for row in rows:
        table.add_row(row.name, *_cells(row))
    return table


def _cells(row: Row) -> tuple[str, ...]:
    skipped = f" ({len(row.others)} not struck)" if row.others else ""
    rate = row.rate
    if rate is None or rate.low is None:
        return (f"0{skipped}", *[""] * 7)
    return (
        f"{len(row.judged)}{skipped}",
        str(row.right),
        f"{rate.low:.0%}",
        str(sum(finding.outcome is RunOutcome.CONVERGED for finding in row.findings)),
        _spread(row.values(recovered_s), 1.0, 1),
        _spread(row.values(lambda finding: finding.braked_s), 1e3, 0),
        _spread(row.values(lambda finding: finding.lost_s), 1.0, 2),
        str(sum(len(finding.left_behind) for finding in row.findings)),
    )


def _spread(values: Sequence[float], factor: float, digits: int) -> str:
    if not values:
        return ""
    return f"{np.median(values) * factor:.{digits}f}, {max(values) * factor:.{digits}f}"
