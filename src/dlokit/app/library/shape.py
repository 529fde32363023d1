"""`dlokit.shape`: one task from a start to a goal, in a call."""

from __future__ import annotations  # or `help` spells out every member of `ArrayLike`

import asyncio
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike

from dlokit.app.console import prepare, progress_console
from dlokit.app.library.run import Run
from dlokit.app.shape.questions import TerminalOperator
from dlokit.app.shape.shape import again_by_config, reported
from dlokit.app.shape.terminal import RunDisplay
from dlokit.communication.timing import virtual_time
from dlokit.errors import ConfigError, require_cell
from dlokit.evaluation.judged_run import judged_run
from dlokit.geometry import resample
from dlokit.skills.planning import api as planning
from dlokit.system.build import Wiring, assemble
from dlokit.system.config import RunConfig, Runtime
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.job import job_from_config, named_or_saved, with_absolute_files
from dlokit.system.request import NOTHING_OWN, Choices, RunRequest, apart
from dlokit.system.results.run_folder import removed_if_refused, run_folder
from dlokit.system.results.run_result import REPORT_FILE
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict

T = TypeVar("T")


def shape(
    start: str | Path | ArrayLike = "I",
    goal: str | Path | ArrayLike = "S",
    *,
    beside: str = "",
    seed: int = 0,
    runtime: Runtime = "lockstep",
    viewer: bool = False,
    settings: Mapping[str, Any] | None = None,
    config: Path | str | None = None,
    out: Path | str | None = None,
    progress: bool = True,
    operator_confirms: bool = False,
    **choices: Unpack[Choices],
) -> Run:
    """Bring the DLO of the simulated cell from a start to a goal by looking at it with a camera.

    `start` and `goal` are ``"I"``, ``"S"``, ``"random"``, a .npy or .csv file, or points (K, 2) or (K, 3) [m] in the
    world frame along the curve, in the order of the rod. `beside` names posts to pass, and on which side, as
    ``"-A +B"``; docs/reference/beside.md. `seed` determines everything random; equal arguments give
    equal runs, to the bit. `choices` are names, as `dlokit shape --help` lists them: ``dlo``, ``physics``,
    ``randomised``, ``camera``, ``driver``, ``observer``, ``segmentation``, ``planner``, and ``installation``, a file
    with the positions of table, arms and camera; an observer and a planner may also be objects of your own, as for
    `dlokit.bench.shaping`. `settings` are further settings by their path in `config.toml`, e.g.
    ``{"task.threshold_m": 0.008, "arms": 2}``; `config` is the config.toml of an earlier run, over which the other
    arguments take precedence. `runtime` ``"live"`` runs all processes in real time; `viewer` serves the page in the
    browser. `out` is an empty folder for what the run writes, by default ``runs/<time>-<name>/``. With `progress` the
    steps and actions are printed while it runs. A run that moves a real arm asks an operator in the terminal before
    anything moves; with `operator_confirms` an operator at the arm has already checked the points of the questions.

    Works in a script, in a notebook, and inside a running event loop, which it blocks. Ctrl-C ends the run with
    outcome ``cancelled``. Raises `InputError` where an argument cannot work, before anything starts.
    """
    require_cell("dlokit.shape")
    named, own = apart(choices)
    if runtime == "live" and own != NOTHING_OWN:
        raise ConfigError(
            "a planner or observer of your own runs in lockstep; for runtime 'live', whose processes do not have it, "
            "install it in a package with an entry point."
        )
    chosen = {"seed": seed, "runtime": runtime, "headless": not viewer} | ({"beside": beside} if beside else {})
    request = RunRequest(config=config, choices=named, settings={**chosen, **(settings or {})})
    with own.known():
        run = request.configured()
        console = progress_console(progress)
        name = f"{_curve_name(start)} to {_curve_name(goal)}"
        folder = run_folder(None if out is None else Path(out), name)
        with removed_if_refused(folder):
            run = replace(run, start=named_or_saved(start, "start", folder), goal=named_or_saved(goal, "goal", folder))
            run = with_absolute_files(run)
            job = replace(job_from_config(run), name=name)
            check_before_start(run, operator_confirms=operator_confirms)
        operator = TerminalOperator(confirms=operator_confirms)
        display = _Display(console, title=name, threshold_m=run.task.threshold_m, operator=operator)

        def whole() -> Run:
            prepare(console, run)
            with display:
                record = judged_run(run, job, folder, display)
            again = again_by_config(folder) if own == NOTHING_OWN else ""  # the command line has no such objects
            record = reported(record, job, folder, display, again)
            return Run(record=record, folder=folder, report=folder / REPORT_FILE)

        return outside_any_loop(whole, display.cancel)


class _Display(RunDisplay):
    """The display of the terminal, which can end the run that it shows."""

    _cancel: Callable[[], object] | None = None
    _cancelled = False

    def started(self, cancel: Callable[[], object]) -> None:
        """The task runs; if it was cancelled while the system started, it ends at once."""
        self._cancel = cancel
        if self._cancelled:
            cancel()

    def cancel(self) -> None:
        """End the task, or, if it does not run yet, end it as soon as it runs."""
        self._cancelled = True
        if self._cancel is not None:
            self._cancel()


def _curve_name(shape_or_points: str | Path | ArrayLike) -> str:
    return Path(shape_or_points).name if isinstance(shape_or_points, str | Path) else "curve"


def judge(
    goal: str | Path | ArrayLike = "S",
    *,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    **choices: Unpack[Choices],
) -> GoalVerdict:
    """Try a goal in the model: does the arm reach it, and does the DLO stay there when it is released?

    `goal` is ``"I"``, ``"S"``, ``"random"`` (drawn from `seed`), a file, or points (K, 2) or (K, 3) [m] in the world
    frame. `choices` (``dlo``, ``installation``, …) and `settings` are the same as for `shape`; the verdict is for the
    configured DLO and ignores the camera's view, because no picture was taken. The verdict's `standing` is ``HOLDS``,
    ``DOUBTFUL`` or ``INFEASIBLE``, `text` gives the reason, and `nearest_world` is the nearest shape that holds.

    Raises `InputError` if the goal or a setting cannot work.
    """
    require_cell("dlokit.judge")
    with tempfile.TemporaryDirectory() as folder:
        config = RunRequest(choices=choices, settings={"seed": seed, **(settings or {})}).configured()
        config = replace(config, goal=named_or_saved(goal, "goal", Path(folder)), headless=True)
        # A goal off the table is judged like any other.
        job = job_from_config(replace(config, task=replace(config.task, infeasible="try")))
        assert job.request is not None
        nodes = resample(np.asarray(job.request.nodes_world), config.model.nodes)
        ends, wish = config.ends_interchangeable, config.wish
        shape = GoalShape(stamp_ns=0, nodes_world=nodes, name=config.goal, ends_interchangeable=ends, beside=wish)
        # A judgement takes about a second: Ctrl-C waits for it.
        return outside_any_loop(lambda: virtual_time.run(_judged(config, shape)), lambda: None)


async def _judged(config: RunConfig, goal: GoalShape) -> GoalVerdict:
    async with assemble(["planning"], config, Wiring()) as host:
        outcome = await host.transport.call(planning.JUDGE_GOAL, goal, config.task.threshold_m)
    return outcome.unwrap("the goal was not judged")


def outside_any_loop(function: Callable[[], T], cancel: Callable[[], object]) -> T:
    """Call `function`, on another thread if an event loop runs on this one.

    Ctrl-C then calls `cancel`, which must make the function return soon; its result is returned.
    """
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return function()
    with ThreadPoolExecutor(1, thread_name_prefix="dlokit") as pool:
        future = pool.submit(function)
        try:
            return future.result()
        except KeyboardInterrupt:
            cancel()
            return future.result()
