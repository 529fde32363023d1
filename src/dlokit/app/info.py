"""`dlokit info`: what is in a recording."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.communication.recording.channels import FILE_NAME
from dlokit.communication.recording.summary import RecordingSummary, summarise

TABLE_WIDTH = 100
CUT_OFF = "The file was cut off: its writer was killed. What came before is whole, and all that is shown here."


@dataclass(frozen=True, kw_only=True)
class InfoArgs:
    """Say what is in a recording: its run, versions, topics with counts and rates, skill calls with outcomes.

    Every `dlokit shape` and `dlokit demo` leaves one, unless told not to by `--no-record`.

    Try
      dlokit info runs/<run>/recording.mcap
      dlokit info runs/<run>                  the same

    The file opens in Foxglove as well. Exit code: 0, also when the file was cut off; 2 when it is no recording.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The recording.mcap of a run, or the run's folder."""


def run(args: InfoArgs) -> int:
    """Read the file through and print."""
    path = args.file / FILE_NAME if args.file.is_dir() else args.file
    summary = summarise(path)
    console = Console()
    # A table that folds its figures cannot be read: a narrow or unknown width is overruled.
    console = Console(width=max(console.width, TABLE_WIDTH))
    for line in _head(path, summary):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    console.print(_topics(summary))
    console.print(_calls(summary.calls))
    return 0


def _head(path: Path, summary: RecordingSummary) -> list[str]:
    about = summary.metadata.get("run", {})
    lines = [
        f"{path}: {summary.duration_s:.1f} s on the run's clock, {summary.size_bytes / 1e6:.1f} MB",
        f"run: {_pairs(about)}",
        f"versions: {_pairs(summary.metadata.get('versions', {}))}",
    ]
    last = summary.last_step
    if last is not None:
        ended = "it had not ended" if last.outcome is None else f"outcome {last.outcome.value}"
        lines.append(f"last step: {last.step}, after {last.actions} actions; {ended}")
    for name, what in (("lost", "not recorded, because the disk was slow"), ("thinned", "left out, as the rate says")):
        if entries := {topic: number for topic, number in summary.metadata.get(name, {}).items() if number != "0"}:
            lines.append(f"{what}: {_pairs(entries)}")
    return lines if summary.whole else [*lines, CUT_OFF]


def _pairs(entries: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in entries.items()) or "not known"


def _topics(summary: RecordingSummary) -> Table:
    table = Table(title="topics", caption="view/… repeats what Foxglove can show")
    for heading in ("topic", "type", "messages", "per s"):
        table.add_column(heading, justify="left" if heading in ("topic", "type") else "right", no_wrap=True)
    for name, channel in sorted(summary.channels.items()):
        rate = "-" if channel.rate_hz is None else f"{channel.rate_hz:.1f}"
        table.add_row(name, channel.schema, str(channel.count), rate)
    return table


def _calls(calls: Mapping[str, Counter[str]]) -> Table:
    table = Table(title="skill calls")
    table.add_column("skill", no_wrap=True)
    table.add_column("outcomes")
    for skill, outcomes in sorted(calls.items()):
        table.add_row(skill, ", ".join(f"{number} {outcome}" for outcome, number in outcomes.most_common()))
    return table
