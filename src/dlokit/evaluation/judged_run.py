"""A run in the runtime that its configuration names, and the evaluator's word on it, in one call."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec

from dlokit.evaluation.evaluator import evaluate, read_truth, with_truth
from dlokit.functional.cell.episode import Episode, draw_episode
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.results.run_record import RunRecord
from dlokit.system.results.run_result import write_nearest, write_result
from dlokit.system.shaping import ShapeJob, Watcher
from dlokit.system.toml_config import to_toml


def run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher) -> RunRecord:
    """Run a task to its end; the cell leaves its truth in `folder`."""
    match config.runtime:
        case "lockstep":
            from dlokit.system.lockstep import run_lockstep

            return run_lockstep(config, job, folder, watch)
        case "live":
            from dlokit.system.live import run_live

            return run_live(config, job, folder, watch)


Runner = Callable[[RunConfig, ShapeJob, Path, Watcher], RunRecord]


def judged_run(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, runner: Runner = run) -> RunRecord:
    """Run a task with `runner`, then compare it with the cell's hidden truth; writes `config.toml` and `result.json`.

    Without a cell there is no truth, and the result keeps the system's own estimates alone. The drawn properties of a
    randomised cell are truth as well, and are in the result.
    Where the goal does not hold and a shape near it does, that is written as `nearest_goal.csv`.
    """
    (folder / CONFIG_FILE).write_text(to_toml(config), encoding="utf-8")
    record = runner(config, job, folder, watch)
    if config.has_cell:
        errors = evaluate(record, read_truth(folder))
        result = msgspec.structs.replace(with_truth(record.result, errors), episode=drawn(config))
        record = replace(record, result=result)
    write_result(folder, record.result)
    if record.verdict is not None:
        write_nearest(folder, record.verdict)
    return record


def drawn(config: RunConfig) -> Episode | None:
    """What the cell of a run drew; None where nothing is randomised."""
    return draw_episode(config.cell, config.seed) if config.cell.randomised else None
