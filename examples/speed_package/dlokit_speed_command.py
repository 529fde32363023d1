"""`dlokit speed`: how fast the middle of the DLO moved in a recorded run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from dlokit_speed import NodeSpeed

import dlokit
from dlokit.app.commands import CliCommand


@dataclass(frozen=True, kw_only=True)
class SpeedArgs:
    """Print how fast the middle of the DLO moved in a recorded run.

    Try
      dlokit speed runs/<run>
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""


def run(args: SpeedArgs) -> int:
    """Print the fastest. Exit code: 0; 1 where the run recorded no speed."""
    messages = (recorded.message for recorded in dlokit.open_run(args.run).messages("speed/node"))
    speeds = [message.speed_m_s for message in messages if isinstance(message, NodeSpeed)]
    if not speeds:
        print("no speed was recorded: was dlokit-speed installed when the run was made?")
        return 1
    print(f"{len(speeds)} speeds, at most {max(speeds) * 1e3:.1f} mm/s")
    return 0


COMMAND = CliCommand(SpeedArgs, run)
