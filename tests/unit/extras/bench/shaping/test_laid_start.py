"""The start of a case without a cell."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from shaping_results import BENT, FARTHEST, run

from dlokit.extras.bench.shaping import laid_start
from dlokit.extras.bench.shaping.cases import ShapingCase
from dlokit.extras.bench.shaping.experiments import RANDOM
from dlokit.extras.bench.shaping.laid_start import StartNotLaid, lay_start
from dlokit.extras.bench.shaping.runner import case_config, job_of
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_result import RunRecord
from dlokit.system.shaping import Watcher
from dlokit.types.flow import RunOutcome

CONFIG = RunConfig(camera=RealSenseConfig(), driver=KinematicRobotConfig())
CASE = ShapingCase(experiment=replace(BENT, start=RANDOM), seed=3, method=FARTHEST)


def _ends(monkeypatch: pytest.MonkeyPatch, outcome: RunOutcome) -> list[tuple[RunConfig, ShapeJob]]:
    """Let the task end so, without an arm; gives what was asked for."""
    asked: list[tuple[RunConfig, ShapeJob]] = []

    def judged(config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher) -> RunRecord:
        asked.append((config, job))
        result = msgspec.structs.replace(run([0.05, 0.030], outcome=outcome), true_rmse_m=None)
        return RunRecord(name=job.name, result=result, goal_nodes_world=job.start_nodes_world)

    monkeypatch.setattr(laid_start, "judged_run", judged)
    return asked


def test_the_start_is_a_goal_for_the_configured_planner_in_either_order_of_the_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = _ends(monkeypatch, RunOutcome.CONVERGED)

    assert lay_start(CASE, CONFIG, tmp_path, Watcher()) is RunOutcome.CONVERGED

    ((config, job),) = asked
    in_cell = RunConfig()
    same_case = job_of(CASE, case_config(CASE, in_cell, tmp_path))
    assert job.request is not None
    assert np.allclose(job.request.nodes_world, same_case.start_nodes_world)  # as a cell would lay it
    assert job.request.ends_interchangeable
    assert len(job.start_nodes_world) == 0
    assert config.planning.strategy.name == "rollout"  # of the sweep, not of the case
    assert np.array_equal(np.load(config.goal), job.request.nodes_world)


def test_a_start_that_was_not_reached_is_an_error_that_says_how_far_off_and_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ends(monkeypatch, RunOutcome.STALLED)

    with pytest.raises(StartNotLaid, match=r"stalled, the DLO lies 30\.0 mm from it .* by hand, and repeat"):
        lay_start(CASE, CONFIG, tmp_path, Watcher())


def test_ctrl_c_while_the_start_is_laid_ends_the_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _ends(monkeypatch, RunOutcome.CANCELLED)

    assert lay_start(CASE, CONFIG, tmp_path, Watcher()) is RunOutcome.CANCELLED


def test_without_a_cell_a_case_is_live_and_nobody_is_told_a_start(tmp_path: Path) -> None:
    config = case_config(CASE, CONFIG, tmp_path)

    assert config.runtime == "live"
    assert config.start == RANDOM
    assert len(job_of(CASE, config).start_nodes_world) == 0
