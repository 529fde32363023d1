"""`dlokit record`: record a running live system from another shell."""

import asyncio
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated

from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.errors import EXIT_OTHERWISE, InputError
from dlokit.recording.summary import summarise
from dlokit.system.processes.running import the_running_system
from dlokit.system.results.recording import record_until_ended


@dataclass(frozen=True, kw_only=True)
class RecordArgs:
    """Record a running live system until Ctrl-C or until it ends: all topics and all skill calls.

    A live run records itself unless `--no-record` is given; use this command for such runs, or for a part of a run.

    Try
      dlokit shape --runtime live --no-record        in one shell
      dlokit record --out grasp.mcap                 in another; Ctrl-C
      dlokit info grasp.mcap

    Exit code: 0 the file is complete; 2 no system runs, or the file exists or cannot be written; 3 not all, or nothing,
    was recorded.
    """

    out: Annotated[Path | None, flag("FILE", "<time>.mcap")] = None
    """Output file; an existing file is never overwritten."""
    run: Annotated[Path | None, flag("DIR")] = None
    """Folder of the run, needed when several systems run."""


def run(args: RecordArgs) -> int:
    """Attach to the system, record, and print a summary."""
    system = the_running_system(args.run)
    path = args.out or Path(f"{datetime.now():%Y%m%d-%H%M%S}.mcap")
    if path.exists():
        raise InputError(f"{path} exists; recordings are never overwritten: name another file with --out.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder of {path} cannot be created: {error}; name another file with --out.") from error
    output = partial(say, Console())
    try:
        output(asyncio.run(record_until_ended(system, path, output)))
    except KeyboardInterrupt:
        output("stopped")
    lines, code = result(path)
    output("\n".join(lines))
    return code


def result(path: Path) -> tuple[list[str], int]:
    """What a recording that has ended contains and lacks, in lines, and the exit code: 3 where it lacks something."""
    if not path.is_file():
        return [f"{path}: nothing was recorded, and there is no file"], EXIT_OTHERWISE
    summary = summarise(path)
    messages = sum(channel.count for name, channel in summary.channels.items() if not name.startswith("view/"))
    calls = sum(sum(of.outcomes.values()) for of in summary.calls.values())
    lines = [
        f"{path}: {messages} messages, including {calls} skill calls, in {summary.duration_s:.1f} s of the run's time, "
        f"{summary.size_bytes / 1e6:.1f} MB"
    ]
    if summary.missing:
        lines.append(f"the recording is incomplete: {summary.missing}")
    if lost := sum(map(int, summary.metadata.get("lost", {}).values())):
        lines.append(f"{lost} messages were not recorded, because the disk was slow; `dlokit info {path}` lists them")
    if not messages:
        lines.append("nothing was recorded: no message came while this command ran")
    return lines, EXIT_OTHERWISE if len(lines) > 1 else 0


COMMAND = CliCommand(RecordArgs, run)
