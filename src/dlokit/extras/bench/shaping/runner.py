"""Runs one case with its files in its own folder: in a cell in lockstep, without a cell live."""

import logging
import shutil
import traceback
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from dlokit import __version__
from dlokit.communication.component import Component
from dlokit.decision.records import GoalRequest
from dlokit.errors import InputError, raise_interrupt
from dlokit.evaluation.evaluator import read_truth
from dlokit.evaluation.judged_run import judged_run
from dlokit.extras.bench.shaping.cases import CaseResult, CaseShapes, ShapingCase, ShapingMethod, with_method
from dlokit.extras.bench.shaping.experiments import RANDOM, BuiltInGoal
from dlokit.extras.bench.shaping.laid_start import lay_start
from dlokit.extras.bench.shaping.oracle import OracleBuild
from dlokit.skills.observer.kernels import load_kernels
from dlokit.skills.planning.base import Loaded
from dlokit.system.build import Build, Wiring, build_component
from dlokit.system.config import RunConfig, Runtime
from dlokit.system.job import ShapeJob
from dlokit.system.lockstep import run_lockstep
from dlokit.system.request import NOTHING_OWN, OwnStrategies
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.results.run_result import RunRecord, RunResult, read_result
from dlokit.system.shaping import Watcher
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import RunOutcome

log = logging.getLogger(__name__)

SHAPES_FILE = "shapes.npz"
FAULT_FILE = "fault.txt"
START_FILE, GOAL_FILE = "start.npy", "goal.npy"


def attempt_case(
    case: ShapingCase,
    config: RunConfig,
    folder: Path,
    own: OwnStrategies = NOTHING_OWN,
    watch: Watcher | None = None,
) -> CaseResult:
    """Run one case; an error is reported in its result and does not end the other cases.

    Files of a previous attempt in `folder` are removed. `own` are strategies of the calling program, `watch`
    confirms the start of a run with a real arm, and acknowledges Ctrl-C.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        with own.known():
            return run_case(case, config, folder, watch or Watcher())
    except Exception as error:  # a failure must not end a sweep of hours
        raise_interrupt(error)
        (folder / FAULT_FILE).write_text(traceback.format_exc(), encoding="utf-8")
        fault = f"{type(error).__name__}: {error}"
        return CaseResult(case=case, result=_broken(case, config, fault), fault=fault)


def run_case(case: ShapingCase, config: RunConfig, folder: Path, watch: Watcher) -> CaseResult:
    """Run one case; the file that marks it as finished is written last. `watch` confirms the start of a real arm.

    Without a cell the arm first brings the DLO to the start, and the shapes are the system's own estimates, as there
    is no truth. Raises `StartNotLaid`.
    """
    of_sweep = replace(config, runtime=runtime_of(config))
    config = case_config(case, config, folder)
    job = job_of(case, config)
    _load(config)
    for name, nodes in ((START_FILE, job.start_nodes_world), (GOAL_FILE, _goal(case, config))):
        if str((folder / name).absolute()) in (config.start, config.goal):
            np.save(folder / name, nodes)
    if not config.has_cell and not config.dry_run and lay_start(case, of_sweep, folder, watch) is RunOutcome.CANCELLED:
        return CaseResult(case=case, result=_broken(case, config, "", RunOutcome.CANCELLED))
    build = build_of(case.method)
    runner = None if build is build_component else partial(run_lockstep, build=build)
    record = judged_run(config, job, folder, watch, runner)
    shapes = _shapes(config, record, folder)
    if shapes is not None and record.result.outcome is not RunOutcome.CANCELLED:
        _write_shapes(folder, shapes)
    return CaseResult(case=case, result=record.result, shapes=shapes)


def build_of(method: ShapingMethod) -> Build:
    """Builds the components of a method: the ground truth in place of the observer, a planner without fixtures."""
    build = _build_blind if method.blind else build_component
    return OracleBuild(build) if method.sees_truth else build


def _build_blind(name: str, config: RunConfig, wiring: Wiring) -> Component:
    """Build the planner without knowledge of the fixtures, and the other components as usual."""
    if name == "planning":
        config = replace(config, installation=replace(config.installation, fixtures=()), beside="")
    return build_component(name, config, wiring)


def _shapes(config: RunConfig, record: RunRecord, folder: Path) -> CaseShapes | None:
    """Start, goal and end of a run: the truth, or without a cell the system's estimates; None if it saw nothing."""
    goal = record.goal_nodes_world
    if config.has_cell:
        truth = read_truth(folder)
        return CaseShapes(start_world=truth.nodes_world[0], goal_world=goal, final_world=truth.nodes_world[-1])
    start = record.start_nodes_world
    if start is None:
        return None
    final = record.actions[-1].nodes_world if record.actions else start
    return CaseShapes(start_world=start, goal_world=goal, final_world=final)


def runtime_of(config: RunConfig) -> Runtime:
    """Lockstep in a cell; a real camera and a real arm work in real time."""
    return "lockstep" if config.has_cell else "live"


def finished_case(case: ShapingCase, folder: Path) -> CaseResult | None:
    """The result of a case in an earlier sweep; None if it is not finished."""
    if not (folder / SHAPES_FILE).is_file():
        return None
    try:
        result = read_result(folder)
        with (folder / SHAPES_FILE).open("rb") as file, np.load(file) as arrays:
            shapes = CaseShapes(**{name: np.asarray(arrays[name]) for name in CaseShapes.__dataclass_fields__})
    except (InputError, OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        log.warning("%s is run again: %s", folder, error)
        return None
    return CaseResult(case=case, result=result, shapes=shapes)


def case_config(case: ShapingCase, config: RunConfig, folder: Path) -> RunConfig:
    """The configuration of a case's run; with `dlokit shape --config` it can be run again by hand."""
    config = with_method(case.experiment.configured(config), case.method)
    goal, start = case.experiment.goal, case.experiment.start
    named_goal = isinstance(goal, BuiltInGoal) and not goal.is_moved
    return replace(
        config,
        start=str((folder / START_FILE).absolute()) if start == RANDOM and config.has_cell else start,
        goal=goal.name if isinstance(goal, BuiltInGoal) and named_goal else str((folder / GOAL_FILE).absolute()),
        seed=case.run_seed,
        runtime=runtime_of(config),
        headless=True,
    )


def job_of(case: ShapingCase, config: RunConfig) -> ShapeJob:
    """The curves of a case: the start for the cell's DLO, if there is one, the goal for the system's model of it."""
    start = case.experiment.start_world(config.cell.dlo, case.run_seed) if config.has_cell else HIDDEN_START
    return ShapeJob(
        name=case.experiment.name,
        start_nodes_world=start,
        request=GoalRequest(
            nodes_world=_goal(case, config),
            name=case.experiment.name,
            ends_interchangeable=config.ends_interchangeable,
        ),
    )


def _load(config: RunConfig) -> None:
    """Load compiled code, which would otherwise be loaded, and timed, in the first decision of a new process."""
    load_kernels((config.observer.strategy,))
    if isinstance(config.planning.strategy, Loaded):
        config.planning.strategy.load()


def _goal(case: ShapingCase, config: RunConfig) -> Float64Array:
    return case.experiment.goal.nodes_world(config.model.length_m, config.model.radius_m)


def _write_shapes(folder: Path, shapes: CaseShapes) -> None:
    part = folder / f"part-{SHAPES_FILE}"
    arrays: Mapping[str, Float64Array] = {name: getattr(shapes, name) for name in CaseShapes.__dataclass_fields__}
    np.savez(part, allow_pickle=False, **arrays)
    part.replace(folder / SHAPES_FILE)


def _broken(case: ShapingCase, config: RunConfig, fault: str, outcome: RunOutcome = RunOutcome.FAILED) -> RunResult:
    return RunResult(
        outcome=outcome,
        reason=fault,
        actions=0,
        rmse_m=None,
        threshold_m=config.task.threshold_m,
        seed=case.run_seed,
        sim_time_s=0.0,
        wall_time_s=0.0,
        planning_time_s=0.0,
        config_hash="",
        version=__version__,
    )
