"""Run a shape task in the runtime that the configuration names."""

from pathlib import Path

from dlokit.system.config import RunConfig
from dlokit.system.live import run_live
from dlokit.system.lockstep import run_lockstep
from dlokit.system.run_record import RunRecord
from dlokit.system.shaping import ShapeJob, Watcher


def run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher) -> RunRecord:
    """Run a task to its end; the cell leaves its truth in `folder`."""
    match config.runtime:
        case "lockstep":
            return run_lockstep(config, job, folder, watch)
        case "live":
            return run_live(config, job, folder, watch)
