"""How a study is started from the command line, and where its figures go."""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.environment import handle_signals
from dlokit.errors import EXIT_BAD_INPUT, EXIT_FAULT, EXIT_INTERRUPTED, ConfigError, DlokitError, InputError
from dlokit.extras.bench.report import BenchFigure, bench_json
from dlokit.extras.bench.report import check_json as check_json  # studies import it from here
from dlokit.system.config import RunConfig
from dlokit.system.results.run_result import machine_facts

A = TypeVar("A")


def run_study(arguments: type[A], run: Callable[[A], int], description: str | None) -> NoReturn:
    """Parse the command line, run the study, and exit with its code; an error of dlokit is one line, not a traceback.

    The fields of `arguments` are the flags; `description` is the help, usually the module's docstring.
    """
    handle_signals()
    args = tyro.cli(arguments, description=description, config=(tyro.conf.AvoidSubcommands,))
    try:
        code = run(args)
    except DlokitError as error:
        print(f"{Path(sys.argv[0]).name}: {error}", file=sys.stderr)
        code = EXIT_BAD_INPUT if isinstance(error, InputError) else EXIT_FAULT
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    sys.exit(code)


def seeds_of(seeds: int, first_seed: int) -> range:
    """The seeds of ``--seeds`` and ``--first-seed``. Raises `ConfigError` when there are none, or one is negative."""
    if seeds < 1 or first_seed < 0:
        raise ConfigError(f"--seeds {seeds} must be at least 1, --first-seed {first_seed} at least 0.")
    return range(first_seed, first_seed + seeds)


Cell = Callable[[Mapping[str, BenchFigure]], str]
"""What a table shows of the figures of one case, by their metrics."""


def value_in(metric: str, factor: float = 1.0, digits: int = 0) -> Cell:
    """The value of a figure, in another unit; of a rate also the lower end of its interval."""

    def cell(figures: Mapping[str, BenchFigure]) -> str:
        if (found := figures.get(metric)) is None:
            return ""
        value = f"{found.value * factor:.{digits}f}"
        if found.unit != "1" or found.low is None:
            return value
        return f"{value} ({found.low * factor:.{digits}f})"

    return cell


def count_in(metric: str) -> Cell:
    """How many samples a figure has."""
    return lambda figures: str(figures[metric].n) if metric in figures else "0"


def figures_table(title: str, caption: str, figures: Sequence[BenchFigure], columns: Mapping[str, Cell]) -> Table:
    """A row for each case; `columns` are by their headings."""
    # Without lines between the columns a table fits into a terminal of 80 columns.
    table = Table(title=title, caption=caption, box=None, padding=(0, 1, 0, 0))
    table.add_column("", no_wrap=True)
    for heading in columns:
        table.add_column(heading, justify="right")
    for case in dict.fromkeys(one.case for one in figures):
        of_case = {one.metric: one for one in figures if one.case == case}
        table.add_row(case, *(cell(of_case) for cell in columns.values()))
    return table


def write_figures(
    path: Path | None, study: str, rows: Sequence[BenchFigure], config: RunConfig | Mapping[str, Any], console: Console
) -> None:
    """Write the figures to the file of `--json`, in the format of every bench; without a file, do nothing."""
    if path is None:
        return
    path.write_bytes(bench_json(study, rows, machine_facts(), config))
    console.print(f"figures: {path}", soft_wrap=True)
