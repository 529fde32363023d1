"""A run in its configured runtime, followed by its evaluation, in one call."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec

from dlokit.description.scene import Fixture
from dlokit.errors import InputError
from dlokit.evaluation.evaluator import (
    SETTLE_S,
    evaluate,
    read_truth,
    with_forces,
    with_true_passing,
    with_truth,
)
from dlokit.functional.cell.drawn_cell import DrawnCell, draw_cell
from dlokit.functional.cell.truth import ROWS_FILE, TRUTH_FILE
from dlokit.recording.disk import Disk
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_folder import write_config
from dlokit.system.results.run_result import FILE_NAME as RESULT_FILE
from dlokit.system.results.run_result import (
    GOAL_FILE_NAME,
    NEAREST_FILE_NAME,
    START_FILE_NAME,
    RunRecord,
    write_goal,
    write_nearest,
    write_result,
    write_seen_start,
)
from dlokit.system.shaping import Watcher
from dlokit.system.signals import interrupts_answered

Runner = Callable[[RunConfig, ShapeJob, Path, Watcher], RunRecord]


def _runner_of(config: RunConfig) -> Runner:
    """The function that runs a task in the configured runtime; the cell writes its truth into the folder."""
    match config.runtime:
        case "lockstep":
            from dlokit.system.lockstep import run_lockstep

            return run_lockstep
        case "live":
            from dlokit.system.live import run_live

            return run_live


def judged_run(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, runner: Runner | None = None
) -> RunRecord:
    """Run a task, then compare it with the cell's hidden truth; writes `config.toml` and the files of `judged`.

    `runner` runs it; None: the configured runtime. Raises `MachineError` when the disk prevents the start of the run.
    """
    runner = runner or _runner_of(config)  # first: the import takes a second, in which a stop would leave no result
    write_config(folder, config)
    record = runner(config, job, folder, watch)
    with interrupts_answered(watch.interrupted_again):
        record = judged(config, record, folder, folder)
    disk = Disk()
    if not (folder / CONFIG_FILE).exists():  # the folder was deleted during the run
        disk.written(CONFIG_FILE, lambda: write_config(folder, config))
    unwritten = {**record.unwritten, **disk.failures}
    if unwritten and config.has_cell and not (folder / TRUTH_FILE).exists():
        unwritten.setdefault(TRUTH_FILE, f"{ROWS_FILE} has what the cell could write")
    return replace(record, unwritten=unwritten)


def judged(config: RunConfig, record: RunRecord, folder: Path, out: Path) -> RunRecord:
    """Compare a task with the truth in `folder`; writes `result.json` and `goal.csv` into `out`.

    Without a cell there is no truth, and the result has only the system's estimates. The drawn properties of a
    randomised cell are truth as well; the result contains them. If the goal does not hold and a shape near it does,
    that shape is written to `nearest_goal.csv`. The record lists files that could not be written as `unwritten`.
    """
    disk, record = Disk(), replace(record, folder=folder.absolute().name)
    if config.has_cell and record.begun:
        try:
            truth = read_truth(folder)
            errors = evaluate(record, truth)
        except InputError as error:
            disk.fail(TRUTH_FILE, record.unwritten.get(TRUTH_FILE, str(error)))
        else:
            result, ends = with_forces(with_truth(record.result, errors), truth), record.ends_interchangeable
            if result.passing is not None:
                result = with_true_passing(result, errors, _standing(config), ends_interchangeable=ends)
            record = replace(record, result=result)
        record = replace(record, result=msgspec.structs.replace(record.result, episode=drawn(config)))
    result, verdict = record.result, record.verdict
    disk.written(RESULT_FILE, lambda: write_result(out, result))
    if record.goal_set:
        disk.written(GOAL_FILE_NAME, lambda: write_goal(out, record.goal_nodes_world))
    if verdict is not None:
        disk.written(NEAREST_FILE_NAME, lambda: write_nearest(out, verdict))
    return replace(record, unwritten={**record.unwritten, **disk.failures})


def _standing(config: RunConfig) -> tuple[Fixture, ...]:
    """The fixtures where the cell of a run really has them."""
    from dlokit.functional.cell.fixtures import true_fixtures  # imports MuJoCo, which a live run does not need here

    drawn_cell = draw_cell(config.cell, config.seed, config.installation)
    return true_fixtures(config.cell, config.installation, drawn_cell)


TRUTH_WITHIN_S = 5.0
"""Longest wait for the rows of truth of a task [s]; a cell writes them once a second."""
_ASKED_EVERY_S = 0.2


def judged_task(config: RunConfig, record: RunRecord, folder: Path, number: int) -> tuple[RunRecord, Path]:
    """As `judged`, for a task of a run that continues; its files are in the folder `task-<number>` of the run.

    A later task of a cell has its start in `start.csv`, as the camera saw it. Blocks until the cell has written the
    truth after the last release, at most `TRUTH_WITHIN_S`. Returns the folder as well.
    """
    out = folder / f"task-{number}"
    out.mkdir(exist_ok=True)
    releases = [action.release_stamp_ns for action in record.actions if action.release_stamp_ns is not None]
    if config.has_cell and releases:
        _await_truth(folder, max(releases) + round(SETTLE_S * 1e9))
    record = judged(config, record, folder, out)
    start = record.start_nodes_world
    if config.has_cell and number > 1 and start is not None:
        disk = Disk()
        disk.written(START_FILE_NAME, lambda: write_seen_start(out, start))
        record = replace(record, unwritten={**record.unwritten, **disk.failures})
    return record, out


def _await_truth(folder: Path, stamp_ns: int) -> None:
    end_s = time.monotonic() + TRUTH_WITHIN_S
    while time.monotonic() < end_s:
        with suppress(InputError):
            if read_truth(folder).stamps_ns[-1] >= stamp_ns:
                return
        time.sleep(_ASKED_EVERY_S)


def drawn(config: RunConfig) -> DrawnCell | None:
    """The properties that the cell of a run drew; None if nothing is randomised."""
    return draw_cell(config.cell, config.seed, config.installation) if config.cell.randomised else None
