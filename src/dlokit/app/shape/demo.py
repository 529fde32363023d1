"""`dlokit demo`: the main job, live, with the viewer."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from dlokit.app.commands import CliCommand, flag
from dlokit.app.shape import shape
from dlokit.system.config import RunConfig


@dataclass(frozen=True, kw_only=True)
class DemoArgs:
    """Watch a simulated arm bring a rope from I to S by looking at it with a stereo camera.

    Starts the simulated cell and every process, opens the viewer (the address is printed), and leaves a report.
    """

    seed: int = 0
    """Another seed, another camera error and noise."""
    port: int = 8080
    """TCP port of the viewer's page."""
    headless: bool = False
    """Without the viewer."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-I-to-S/")] = None
    """Folder for what the run leaves."""


def run(args: DemoArgs) -> int:
    """Run it; the exit code is that of `dlokit shape`."""
    config = RunConfig(runtime="live", seed=args.seed, headless=args.headless)
    config = replace(config, viewer=replace(config.viewer, port=args.port))
    return shape.run(shape.ShapeArgs(run=config, choices=shape.ShapeChoices(out=args.out)))


COMMAND = CliCommand(DemoArgs, run)
