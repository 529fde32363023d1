"""`dlokit view`: watch a recorded run on the viewer's page."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.errors import InputError
from dlokit.recording.reader import recording_file
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.watching import WATCHED_PARTS, watch


@dataclass(frozen=True, kw_only=True)
class ViewArgs:
    """Watch a recorded run in the browser: play, pause and seek it on a timeline with its steps and actions.

    Waits in which no arm moves are skipped, unless you say otherwise on the page. Nothing on it moves an arm.

    Try
      dlokit view runs/<run>             open the printed address; the run plays when the page opens
      dlokit view runs/<run> --speed 4   four seconds of the run per second
      dlokit view runs/<run> --port 0    on any free port, e.g. beside a live run
      dlokit view runs/<run>/recording.001.mcap    one part of a run of hours: all of it takes 1.2 GB of memory an hour

    Runs that were killed can be watched up to that moment. Ctrl-C closes the page. `dlokit export RUN --to mp4` makes a
    video of it. Exit code: 0 after Ctrl-C, 1 the page could not be served, 2 bad input.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The folder of a run, or its recording.mcap, or one part of it."""
    speed: float = 1.0
    """Seconds of the run per second, at first; it can be changed on the page."""
    port: Annotated[int | None, flag("N")] = None
    """TCP port of the page; 0 takes any free one. Default: the port of the run."""


def run(args: ViewArgs) -> int:
    """Serve the page until Ctrl-C."""
    if not (math.isfinite(args.speed) and args.speed > 0.0):
        raise InputError(f"--speed is {args.speed:g}; it must be greater than 0, e.g. 2 for double speed.")
    path = recording_file(args.file)
    config = recorded_config(path, WATCHED_PARTS)
    watch(path, config, args.speed, args.port, partial(say, Console()))
    return 0


COMMAND = CliCommand(ViewArgs, run)
