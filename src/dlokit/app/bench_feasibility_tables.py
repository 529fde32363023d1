"""What `dlokit bench feasibility` prints."""

from collections import Counter
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from dlokit.bench.feasibility.beliefs import Level
from dlokit.bench.feasibility.cases import Judged
from dlokit.bench.feasibility.figures import ALL, figures, is_right
from dlokit.bench.feasibility.releases import Happened
from dlokit.bench.report import Figure
from dlokit.types.feasibility import Standing

_KNOWN = {
    Level.RULER: "length and radius told, the rest as shipped",
    Level.TOLD: "nominal figures told, off as the shipped ones are; and whether it takes a set",
    Level.LEARNT: "beliefs drawn around the truth: EI / (μ w) to 12 %, yield to 20 % (1 sd)",
}


def print_results(rows: Sequence[Judged], console: Console) -> None:
    """For each level of knowledge what was said against what happened; then rates, times and every wrong verdict."""
    found = figures(rows)
    for level in Level:
        of = [row for row in rows if row.level is level]
        if not of:
            continue
        console.print(f"[bold]{level.value}[/]: {_KNOWN[level]}", highlight=False, soft_wrap=True)
        console.print(_table(of))
        for figure in found:
            if figure.case == ALL and figure.method == level.value:
                console.print(f"  {_line(figure)}", highlight=False)
    for row in rows:
        if not is_right(row):
            console.print(
                f"wrong: {row.dlo}, {row.goal}, {row.level.value}: said {row.standing.value}, "
                f"{row.happened.value}; sprang back {row.true_rmse_m * 1e3:.1f} mm, "
                f"at best {row.best_rmse_m * 1e3:.1f} mm",
                highlight=False,
                soft_wrap=True,
            )


def _table(rows: Sequence[Judged]) -> Table:
    counts = Counter((row.dlo, row.standing, row.happened) for row in rows)
    table = Table(caption="goals: stayed / reached by another shape / missed")
    for heading in ("", *(standing.value for standing in Standing)):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for dlo in dict.fromkeys(row.dlo for row in rows):
        cells = (" / ".join(str(counts[dlo, said, what]) for what in Happened) for said in Standing)
        table.add_row(dlo, *cells)
    return table


def _line(figure: Figure) -> str:
    if figure.unit == "s":
        return f"{figure.metric}: {figure.value:.2f} s"
    assert figure.low is not None
    assert figure.high is not None
    hits = round(figure.value * figure.n)
    return f"{figure.metric}: {hits} of {figure.n} ({figure.low:.0%} to {figure.high:.0%})"
