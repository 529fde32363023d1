"""`dlokit demo`: a complete live run with the viewer."""

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.app.shape import shape
from dlokit.system.request import Choices, RunRequest


@dataclass(frozen=True, kw_only=True)
class DemoArgs:
    """Watch a simulated arm move a rope from shape I to shape S, guided by a stereo camera.

    Starts the simulated cell and all processes, opens the viewer (its address is printed), and writes a report. In a
    terminal the run then stays, and the page takes the next goal: draw one, and press “Shape it”.
    """

    seed: int = 0
    """Random seed of the camera's pose error and noise."""
    port: int = 8080
    """TCP port of the viewer's page."""
    installation: Annotated[Path | None, flag("FILE", "the paper's cell")] = None
    """Poses of table, arms and camera (docs/how-to/describe-an-installation.md)."""
    dry_run: bool = False
    """Plan the first action and show it; the arm does not move."""
    headless: bool = False
    """Run without the viewer."""
    stay: bool = True
    """After the task, take the next goals from the page until “End run” or Ctrl-C. Without a terminal, and with
    --headless or --dry-run, the demo ends with its task."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-I-to-S/")] = None
    """Folder for the files of the run."""


NEXT = {
    "dlokit shape --runtime live --goal interactive": "set goal after goal in the browser",
    "dlokit shape --start random --goal S --seed 3": "another start, faster than real time",
    "dlokit shape --goal FILE.csv --fit-length": "your own curve, points in metres",
}
"""Suggested next commands, each with its purpose."""


def run(args: DemoArgs) -> int:
    """Run the demo and suggest next commands; the exit code is that of `dlokit shape`."""
    wished = {"runtime": "live", "seed": args.seed, "headless": args.headless, "dry_run": args.dry_run}
    choices = Choices(installation=args.installation)
    config = RunRequest(choices=choices, settings={**wished, "viewer.port": args.port}).configured()
    console = Console()
    stay = args.stay and console.is_terminal and shape.can_stay(config)
    code = shape.run(shape.ShapeArgs(run=config, options=shape.ShapeOptions(out=args.out, stay=stay)))
    console.print("\nTry next:")
    for command, does in NEXT.items():
        # Commands are not wrapped, so that they can be copied.
        say(console, f"  {_here(command):<60}  {does}")
    return code


def _here(command: str) -> str:
    """The command for this shell: with its folder if `dlokit` is not on the path, as after `make demo`."""
    script = Path(sys.argv[0])
    known = shutil.which("dlokit") is not None or not script.is_file() or script.name != "dlokit"
    return command if known else command.replace("dlokit", str(script), 1)


COMMAND = CliCommand(DemoArgs, run)
