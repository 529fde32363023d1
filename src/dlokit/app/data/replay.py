"""`dlokit replay`: replay a recorded run into one component."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.table import Table

from dlokit.app.commands import CliCommand
from dlokit.app.console import console_of_width, say
from dlokit.errors import EXIT_FAULT
from dlokit.recording.comparison import FieldRow
from dlokit.recording.reader import recording_file
from dlokit.system.config import RunConfig
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.configuration.toml_config import read_toml
from dlokit.system.replay import Replay, replay, replayable

TABLE_WIDTH = 125


def _replayable_names() -> Any:
    return Literal[tuple(replayable())]


@dataclass(frozen=True, kw_only=True)
class ReplayArgs:
    """Replay the recorded inputs of one component, and compare its outputs with the recorded ones.

    Try
      dlokit replay runs/<run>/recording.mcap --into observer     each field, its largest deviation, its tolerance
      dlokit replay runs/<run> --into observer --config other.toml   the outputs of another observer

    `dlokit view` shows a run to people. Exit code: 0 all fields within their tolerances, 1 a field outside (it is
    named), 2 bad input.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The recording.mcap of a run, or the folder of the run."""
    into: Annotated[str, tyro.conf.arg(constructor_factory=_replayable_names)]
    """The component to feed. The recorded calls of its skills are repeated with the same arguments at the same
    times."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """A configuration to use instead of the recorded run's."""


def run(args: ReplayArgs) -> int:
    """Feed the component and compare."""
    path = recording_file(args.file)
    config = (
        recorded_config(path, replayable()[args.into]) if args.config is None else read_toml(args.config, RunConfig)
    )
    return _fed(path, args.into, replay(path, args.into, config))


def _fed(path: Path, name: str, done: Replay) -> int:
    console = console_of_width(TABLE_WIDTH)
    console.print(_table(f"{name}, fed from {path}", done.rows))
    for line in _notes(done):
        say(console, line)
    beyond = [row for row in done.rows if not row.within]
    for row in beyond:
        say(
            console,
            f"outside its tolerance: {row.what} {row.field}: {_number(row.largest)}, allowed {_number(row.allowed)} "
            f"({row.tolerance.why}); at {row.at_ns / 1e9:.3f} s",
        )
    if not beyond:
        say(console, f"{name} reproduces the recording: every field is within its tolerance.")
    return EXIT_FAULT if beyond else 0


def _notes(done: Replay) -> list[str]:
    notes: list[str] = []
    if done.left_out:
        notes.append(f"{done.left_out} looks are not compared: the recording rate omitted their pictures.")
    if done.unknown_calls:
        notes.append(f"{done.unknown_calls} calls were not repeated: the recording does not contain all of their data.")
    if done.uncompared:
        notes.append(f"not compared, because a live decision ends by wall time: {', '.join(done.uncompared)}.")
    return notes


def _table(title: str, rows: list[FieldRow]) -> Table:
    table = Table(title=title)
    for heading in ("topic or skill", "field"):
        table.add_column(heading, no_wrap=True)
    for heading in ("compared", "largest deviation", "tolerance"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        style = None if row.within else "bold red"
        allowed = "any" if math.isinf(row.allowed) else _number(row.allowed)
        table.add_row(row.what, row.field, str(row.compared), _number(row.largest), allowed, style=style)
    return table


def _number(value: float) -> str:
    return "differs" if math.isinf(value) else f"{value:.3g}"


COMMAND = CliCommand(ReplayArgs, run)
