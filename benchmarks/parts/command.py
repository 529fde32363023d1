"""How a study is started from the command line, and where its figures go."""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import tyro
from rich.console import Console

from dlokit.app.stop_signals import handle_signals
from dlokit.benches.report import BenchFigure, bench_json
from dlokit.errors import EXIT_BAD_INPUT, EXIT_FAULT, EXIT_INTERRUPTED, DlokitError, InputError
from dlokit.system.config import RunConfig
from dlokit.system.results.run_record import machine_facts

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


def check_json(path: Path | None) -> None:
    """Raise `InputError` where the file of figures could not be written; called before a study starts."""
    if path is not None and not path.resolve().parent.is_dir():
        raise InputError(f"--json {path}: there is no folder {path.resolve().parent}; create it first.")


def write_figures(
    path: Path | None, study: str, rows: Sequence[BenchFigure], config: RunConfig | Mapping[str, Any], console: Console
) -> None:
    """Write the figures to the file of `--json`, in the format of every bench; without a file, do nothing."""
    if path is None:
        return
    path.write_bytes(bench_json(study, rows, machine_facts(), config))
    console.print(f"figures: {path}", soft_wrap=True)
