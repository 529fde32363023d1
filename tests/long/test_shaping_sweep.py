"""A small sweep as a whole: in parallel, in sequence, on a Dask cluster, and continued after Ctrl-C."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from dlokit.errors import MachineError
from dlokit.extras.bench.shaping import sweep
from dlokit.extras.bench.shaping.cases import IDEAL, CaseResult, ShapingCase, ShapingMethod, cases
from dlokit.extras.bench.shaping.runner import SHAPES_FILE
from dlokit.extras.bench.shaping.suites import paper_suite
from dlokit.extras.bench.shaping.sweep import Workers, run_sweep
from dlokit.system.config import RunConfig
from dlokit.system.request import OwnStrategies
from dlokit.system.results.run_result import RunResult

DLOKIT = str(Path(sys.executable).with_name("dlokit"))
LIMIT_S = 180.0  # a run of one action with the oracle takes 4 s of an idle core
CONFIG = replace(RunConfig(record=False), task=replace(RunConfig().task, max_actions=1, infeasible="try"))
CASES: list[ShapingCase] = list(cases(paper_suite()[1:2], 2, (ShapingMethod(observer=IDEAL, planner="farthest"),)))


def _figures(results: list[CaseResult]) -> dict[int, Any]:
    """The part of a run's result that is independent of machine and folder."""
    return {done.case.seed: _lasting(done.result) for done in results}


def _lasting(result: RunResult) -> RunResult:
    history = tuple(msgspec.structs.replace(row, planning_time_s=0.0) for row in result.history)
    return msgspec.structs.replace(result, wall_time_s=0.0, planning_time_s=0.0, config_hash="", history=history)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Any]:
    return _figures(list(run_sweep(CASES, CONFIG, tmp_path_factory.mktemp("alone"), Workers())))


def test_parallel_cases_give_the_same_results_as_sequential_ones(tmp_path: Path, alone: dict[int, Any]) -> None:
    side_by_side = list(run_sweep(CASES, CONFIG, tmp_path, Workers(jobs=2)))

    assert not any(done.fault for done in side_by_side)
    assert _figures(side_by_side) == alone


def test_a_dask_cluster_gives_the_same(tmp_path: Path, alone: dict[int, Any]) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `sweeps` is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        address: str = cluster.scheduler_address
        on_the_cluster = list(run_sweep(CASES, CONFIG, tmp_path, Workers(cluster=address)))

    assert not any(done.fault for done in on_the_cluster)
    assert _figures(on_the_cluster) == alone


def test_an_interrupted_sweep_names_the_command_that_continues_it(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    command = [DLOKIT, "bench", "shaping", "--oracle", "--seeds", "1", "--max-actions", "1", "--out", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as sweep:
        assert sweep.stdout is not None
        for line in sweep.stdout:
            if line.startswith("1/5 I to S"):
                break
        sweep.send_signal(signal.SIGINT)
        said, _ = sweep.communicate(timeout=LIMIT_S)
    assert sweep.returncode == 130, said
    assert f"--out {folder} continues" in " ".join(said.split())
    first = next(folder.glob(f"I-to-S-*/{SHAPES_FILE}")).stat().st_mtime_ns
    assert not list(folder.glob(f"S-to-I-*/{SHAPES_FILE}"))

    again = subprocess.run(command, capture_output=True, text=True, timeout=5 * LIMIT_S, check=False)

    assert again.returncode == 0, again.stdout + again.stderr
    assert next(folder.glob(f"I-to-S-*/{SHAPES_FILE}")).stat().st_mtime_ns == first
    assert len(list(folder.glob(f"*/{SHAPES_FILE}"))) == 5
    assert list(folder.glob("cases-*.png"))


def _die(case: ShapingCase, config: RunConfig, folder: Path, own: OwnStrategies) -> CaseResult:
    os._exit(9)


def test_a_dead_worker_is_reported_with_the_command_to_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep, "attempt_case", _die)

    with pytest.raises(MachineError, match="fewer --jobs"):
        list(run_sweep(CASES[:1], CONFIG, tmp_path, Workers(jobs=2)))
