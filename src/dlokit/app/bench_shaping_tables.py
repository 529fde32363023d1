"""What `dlokit bench shaping` prints."""

from collections.abc import Sequence
from itertools import chain

from rich.console import Console
from rich.table import Table

from dlokit.bench.shaping.cases import CaseResult
from dlokit.bench.shaping.metrics import falsely_converged, standing
from dlokit.bench.shaping.rows import experiment_rows, group_rows, verdict_row
from dlokit.bench.shaping.tables import COLUMNS, outcomes, overview, verdict_lines
from dlokit.types.feasibility import Standing

TABLE_WIDTH = 190
MOST_EXPERIMENTS = 15
"""A suite of more experiments has a table of its groups; all figures are in the JSON file."""
_LEFT = 2


def line_of(done: CaseResult) -> str:
    """A case in one line."""
    case, result = done.case, done.result
    rmse = "-" if result.rmse_m is None else f"{result.rmse_m * 1e3:.1f} mm"
    true = "-" if result.true_rmse_m is None else f"{result.true_rmse_m * 1e3:.1f} mm"
    actions = "action" if result.actions == 1 else "actions"
    return (
        f"{case.experiment.name:12} seed {case.seed}  {case.method.name:14}  {result.outcome.value:10} "
        f"{result.actions:3d} {actions:7}  RMSE {rmse:>8}  true {true:>8}  "
        f"{result.sim_time_s:6.1f} s simulated in {result.wall_time_s:6.1f} s"
        + ("  (FALSE)" if falsely_converged(result) else "")
        + (f"  ({result.reason})" if result.reason else "")
    )


def print_results(results: Sequence[CaseResult], console: Console) -> None:
    """The tables, how runs ended, and verdicts against what happened."""
    # A table that folds its figures cannot be read: a narrow or unknown width is overruled.
    wide = Console(file=console.file, width=max(console.width, TABLE_WIDTH))
    wide.print(_table(results))
    for heading, lines in (("how runs ended", outcomes(results)), ("verdicts", verdict_lines(results))):
        console.print(f"[bold]{heading}[/]", highlight=False)
        for line in lines:
            console.print(f"  {line}", highlight=False, soft_wrap=True, markup=False)
    for done in results:
        if done.fault:
            where = f"{done.case.experiment.name}, seed {done.case.seed}, {done.case.method.name}"
            console.print(f"broke down, run again by the same command: {where}: {done.fault}", markup=False)


def _table(results: Sequence[CaseResult]) -> Table:
    table = Table(caption="median (largest) over runs; by kind: all runs together; false: reported below, truly above")
    for at, heading in enumerate(COLUMNS):
        table.add_column(heading, justify="left" if at < _LEFT else "right", no_wrap=True)
    few = len({done.case.experiment.name for done in results}) <= MOST_EXPERIMENTS
    rows = chain(experiment_rows(results), group_rows(results)) if few else group_rows(results)
    # Where all goals have the same verdict, its row says what the last one says.
    repeated = {verdict_row(said) for said in Standing if all(standing(done.result) is said for done in results)}
    for row in overview(row for row in rows if row.name not in repeated):
        table.add_row(*row)
    return table
