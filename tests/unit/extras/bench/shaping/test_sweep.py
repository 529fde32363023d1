from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shaping_results import BENT, FARTHEST, ROLLOUT, STRAIGHT, done, run, same_shapes

from dlokit.errors import ConfigError, InputError, MachineError
from dlokit.extras.bench.shaping import sweep
from dlokit.extras.bench.shaping.cases import IDEAL, CaseResult, CaseShapes, ShapingCase, ShapingMethod, cases
from dlokit.extras.bench.shaping.runner import FAULT_FILE, SHAPES_FILE, attempt_case, case_config, finished_case, job_of
from dlokit.extras.bench.shaping.suites import paper_suite
from dlokit.extras.bench.shaping.sweep import Workers, claim_sweep_folder, cluster_backend, run_sweep
from dlokit.system.config import RunConfig
from dlokit.system.operator_start import StartOperator
from dlokit.system.request import OwnStrategies
from dlokit.system.results.run_result import write_result
from dlokit.types.flow import RunOutcome

CONFIG = RunConfig(record=False)
GOOD = run([0.05, 0.010])


def _finish(folder: Path, result: CaseResult) -> None:
    here = folder / result.case.folder_name
    here.mkdir(parents=True)
    write_result(here, result.result)
    assert result.shapes is not None
    np.savez(here / SHAPES_FILE, **{name: getattr(result.shapes, name) for name in CaseShapes.__dataclass_fields__})


def test_every_planner_gets_the_same_starts_goals_and_cells() -> None:
    todo = list(cases(paper_suite(), 2, (FARTHEST, ROLLOUT), first_seed=7))

    for one, other in zip(todo[::2], todo[1::2], strict=True):
        mine, theirs = (case_config(case, CONFIG, Path("here")) for case in (one, other))
        assert one.method != other.method
        assert mine.seed == theirs.seed
        assert mine.cell == theirs.cell
        my_job, their_job = job_of(one, mine), job_of(other, theirs)
        assert np.array_equal(my_job.start_nodes_world, their_job.start_nodes_world)
        assert my_job.request is not None
        assert their_job.request is not None
        assert np.array_equal(my_job.request.nodes_world, their_job.request.nodes_world)


def test_a_sweep_is_ordered_by_seeds_so_that_a_partial_one_has_every_experiment() -> None:
    assert [case.seed for case in cases((BENT, STRAIGHT), 2, (FARTHEST,))] == [0, 0, 1, 1]


def test_no_two_cases_share_a_folder() -> None:
    todo = list(cases(paper_suite(), 3, (FARTHEST, ROLLOUT)))

    assert len({case.folder_name for case in todo}) == len(todo)


def test_a_finished_case_is_read_and_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = done(GOOD)
    _finish(tmp_path, before)
    ran: list[ShapingCase] = []

    def attempt(
        case: ShapingCase, config: RunConfig, folder: Path, own: OwnStrategies, operator: StartOperator | None
    ) -> CaseResult:
        ran.append(case)
        return done(GOOD, seed=case.seed)

    monkeypatch.setattr(sweep, "attempt_case", attempt)
    todo = [replace(before.case, seed=seed) for seed in (0, 1)]

    results = list(run_sweep(todo, CONFIG, tmp_path, Workers()))

    assert [case.seed for case in ran] == [1]
    assert [result.case.seed for result in results] == [0, 1]
    assert results[0].result == before.result
    assert before.shapes is not None
    assert results[0].shapes is not None
    assert same_shapes(results[0].shapes, before.shapes)


@pytest.mark.parametrize("missing", ["result.json", SHAPES_FILE])
def test_a_case_with_a_missing_or_incomplete_file_is_not_finished(tmp_path: Path, missing: str) -> None:
    _finish(tmp_path, done(GOOD))
    case = done(GOOD).case
    here = tmp_path / case.folder_name
    assert finished_case(case, here) is not None

    (here / missing).write_bytes((here / missing).read_bytes()[:40])
    assert finished_case(case, here) is None
    (here / missing).unlink()
    assert finished_case(case, here) is None


def test_ctrl_c_in_a_run_ends_the_sweep_and_the_run_is_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cancelled = done(run([0.05], outcome=RunOutcome.CANCELLED))
    monkeypatch.setattr(sweep, "attempt_case", lambda case, config, folder, own, watch: cancelled)
    counted: list[CaseResult] = []

    with pytest.raises(KeyboardInterrupt):
        counted.extend(run_sweep([cancelled.case, cancelled.case], CONFIG, tmp_path, Workers()))

    assert counted == []


def test_a_folder_is_continued_with_the_same_settings_and_more_seeds_or_planners(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    claim_sweep_folder(folder, CONFIG, "paper", paper_suite(), oracle=False)
    (folder / "a case").mkdir()

    claim_sweep_folder(folder, replace(CONFIG, seed=5), "paper", paper_suite(), oracle=False)


@pytest.mark.parametrize(
    ("config", "suite", "oracle", "message"),
    [
        (
            replace(CONFIG, task=replace(CONFIG.task, threshold_m=0.006)),
            "paper",
            False,
            "config.task.threshold_m is 0.012",
        ),
        (CONFIG, "wires", False, "suite is paper, here wires"),
        (CONFIG, "paper", True, "oracle is False, here True"),
    ],
)
def test_a_folder_with_other_settings_is_refused_by_the_first_difference(
    tmp_path: Path, config: RunConfig, suite: str, oracle: bool, message: str
) -> None:
    claim_sweep_folder(tmp_path, CONFIG, "paper", paper_suite(), oracle=False)

    with pytest.raises(InputError, match=message):
        claim_sweep_folder(tmp_path, config, suite, paper_suite(), oracle=oracle)


def test_different_goals_with_the_same_name_count_as_other_settings(tmp_path: Path) -> None:
    claim_sweep_folder(tmp_path, CONFIG, "goals", paper_suite(), oracle=False)

    with pytest.raises(InputError, match="experiments"):
        claim_sweep_folder(tmp_path, CONFIG, "goals", paper_suite()[:2], oracle=False)


def test_a_foreign_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()

    with pytest.raises(InputError, match="not empty"):
        claim_sweep_folder(tmp_path, CONFIG, "paper", paper_suite(), oracle=False)


def test_a_run_that_crashes_is_reported_and_not_finished(tmp_path: Path) -> None:
    case = ShapingCase(
        experiment=replace(BENT, start="Z"), seed=0, method=ShapingMethod(observer=IDEAL, planner="farthest")
    )

    broken = attempt_case(case, CONFIG, tmp_path / case.folder_name)

    assert broken.fault is not None
    assert broken.fault.startswith("ShapeError")
    assert broken.result.outcome is RunOutcome.FAILED
    assert "Traceback" in (tmp_path / case.folder_name / FAULT_FILE).read_text()
    assert finished_case(case, tmp_path / case.folder_name) is None


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "ray://127.0.0.1:1", "somewhere"])
def test_an_unreachable_cluster_is_one_clear_error(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr("importlib.import_module", missing)
    expected = ConfigError if address == "somewhere" else MachineError

    with pytest.raises(expected, match=r"pip install|is no address"), cluster_backend(address, 1):
        pass


def _names(todo: Sequence[ShapingCase]) -> list[str]:
    return [case.folder_name for case in todo]


def test_a_folder_name_has_experiment_seed_planner_and_observer() -> None:
    assert _names([done(GOOD, seed=3).case]) == ["I-to-S-3-farthest-map"]
