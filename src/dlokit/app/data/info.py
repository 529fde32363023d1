"""`dlokit info`: summarise a recording."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.markup import escape
from rich.table import Table

from dlokit.app.commands import CliCommand
from dlokit.app.console import console_of_width, say
from dlokit.app.data.differences import RUN_PARTS, ComparedRun, differences
from dlokit.app.shape.outcome_text import NONE
from dlokit.errors import InputError
from dlokit.recording.reader import recording_file, toml_of
from dlokit.recording.summary import RecordingSummary, summarise
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.results.parts_of_run import changed_settings
from dlokit.types.robot import ArmProtection

TABLE_WIDTH = 100
WHOLE = "The file is complete."
CUT_OFF = "The file is truncated or damaged: {}. All other data are intact and shown here."


@dataclass(frozen=True, kw_only=True)
class InfoArgs:
    """Summarise a recording: its run, versions, settings, topics with counts and rates, calls with outcomes.

    Of two runs, print what differs: results side by side, then each setting and version that is not the same.

    Every `dlokit shape` and `dlokit demo` writes a recording, unless `--no-record` is given.

    Try
      dlokit info runs/<run>/recording.mcap
      dlokit info runs/<run>                                   the same
      dlokit info runs/<run> runs/<other>                      what differs between two runs
      dlokit info runs/<run> --configuration > again.toml      all settings; dlokit shape --config again.toml

    Foxglove and Rerun open the file as well. Exit code: 0, also when the file is truncated or damaged; 2 when it is no
    recording.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The recording.mcap of a run, or the folder of the run."""
    other: Annotated[
        Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[OTHER]", help_behavior_hint="(optional)")
    ] = None
    """The recording or the folder of another run, to compare it with the first."""
    configuration: bool = False
    """Print only the complete config.toml of the run."""


def run(args: InfoArgs) -> int:
    """Read the file and print the summary, or what differs between two."""
    path = recording_file(args.file)
    summary = summarise(path)
    if args.other is not None:
        return _compare(ComparedRun(path=path, summary=summary), recording_file(args.other), args)
    if args.configuration:
        print(toml_of(summary.metadata, path), end="")
        return 0
    console = console_of_width(TABLE_WIDTH)
    for line in _head(path, summary):
        say(console, line)
    console.print(_topics(summary))
    console.print(_calls(summary))
    return 0


def _compare(first: ComparedRun, path: Path, args: InfoArgs) -> int:
    if args.configuration:
        raise InputError("--configuration prints the settings of one run: omit it, or the second run.")
    console = console_of_width(TABLE_WIDTH)
    for table in differences(first, ComparedRun(path=path, summary=summarise(path))):
        console.print(table)
    return 0


def _head(path: Path, summary: RecordingSummary) -> list[str]:
    about = summary.metadata.get("run", {})
    files = "" if summary.files == 1 else f" in {summary.files} files"
    lines = [
        f"{path}: {summary.duration_s:.1f} s on the run's clock, {summary.size_bytes / 1e6:.1f} MB{files}",
        f"run: {_pairs(about)}",
        f"settings that differ from the defaults: {_changed_settings(path)}",
        f"versions: {_pairs(summary.metadata.get('versions', {}))}",
        f"pictures: {_pairs(summary.metadata.get('pictures', {}))}",
    ]
    last = summary.last_step
    if last is not None:
        ended = "it had not ended" if last.outcome is None else f"outcome {last.outcome.value}"
        done = "1 action" if last.actions == 1 else f"{last.actions} actions"
        lines.append(f"last step: {last.step}, after {done}; {ended}")
    lines += [_protection(each) for each in summary.protections]
    for name, what in (
        ("lost", "not recorded, because the disk was slow"),
        ("thinned", "messages omitted to keep the file small (pictures above their rate, states of an arm at rest)"),
        ("deleted", "deleted, because the recording became too large; the first file and the newest are kept"),
    ):
        if entries := {topic: number for topic, number in summary.metadata.get(name, {}).items() if number != "0"}:
            lines.append(f"{what}: {_pairs(entries)}")
    if summary.running:
        lines.append(f"calls that had not ended: {', '.join(summary.running)}")
    return [*lines, CUT_OFF.format(summary.missing) if summary.missing else WHOLE]


def _protection(arm: ArmProtection) -> str:
    when = "after a recovery" if arm.recovered else "on connecting"
    x, y, z = 1e3 * arm.T_flange_tool.position_m
    return (
        f"arm {arm.robot}, {when}: stops itself at {arm.torque_nm:g} N·m of a joint or {arm.force_n:g} N on the tool, "
        f"load {arm.load_kg:g} kg; it reports a tool of {arm.reported_tool_kg:.3f} kg at "
        f"({x:.1f}, {y:.1f}, {z:.1f}) mm from the flange, load {arm.reported_load_kg:.3f} kg"
    )


def _changed_settings(path: Path) -> str:
    """The settings that differ from the defaults of this version."""
    try:
        return _pairs(changed_settings(recorded_config(path, RUN_PARTS)), "none")
    except InputError:  # without a configuration, or with one that this version cannot read
        return "not known"


def _pairs(entries: Mapping[str, str], nothing: str = "not known") -> str:
    return ", ".join(f"{name} {value}" for name, value in entries.items()) or nothing


def _topics(summary: RecordingSummary) -> Table:
    table = Table(title="topics", caption="view/… repeats what Foxglove can show; kB before compression")
    for heading in ("topic", "type", "messages", "per s", "kB"):
        table.add_column(heading, justify="left" if heading in ("topic", "type") else "right", no_wrap=True)
    for name, channel in sorted(summary.channels.items()):
        rate = "-" if channel.rate_hz is None else f"{channel.rate_hz:.1f}"
        # Names come from the file: brackets in them are no markup.
        table.add_row(escape(name), escape(channel.schema), str(channel.count), rate, f"{channel.size_bytes / 1e3:.0f}")
    return table


def _calls(summary: RecordingSummary) -> Table:
    table = Table(title="skill calls", caption="on the run's clock; in lockstep, computing takes no time on it (–)")
    table.add_column("skill", no_wrap=True)
    table.add_column("mean, s", justify="right", no_wrap=True)
    table.add_column("longest, s", justify="right", no_wrap=True)
    table.add_column("outcomes")
    for skill, of in sorted(summary.calls.items()):
        outcomes = ", ".join(f"{number} {outcome}" for outcome, number in of.outcomes.most_common())
        table.add_row(escape(skill), _call_s(of.mean_s), _call_s(of.longest_s), escape(outcomes))
    return table


def _call_s(duration_s: float) -> str:
    return f"{duration_s:.2f}" if duration_s > 0.0 else NONE


COMMAND = CliCommand(InfoArgs, run)
