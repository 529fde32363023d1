"""Input that `dlokit bench shaping` refuses before anything runs, and the size of `--quick`."""

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from shaping_results import done, run

from dlokit.app.commands import parse
from dlokit.errors import ConfigError, InputError
from dlokit.extras.bench.commands.shaping import QUICK_SEEDS, ShapingArgs, expected_duration, line_of, run_shaping
from dlokit.extras.bench.shaping import sweep
from dlokit.extras.bench.shaping.cases import CaseResult, ShapingCase
from dlokit.extras.bench.shaping.suites import SUITE_NAMES, suite_of
from dlokit.system.config import RunConfig
from dlokit.system.request import OwnStrategies
from dlokit.system.shaping import Watcher
from dlokit.types.flow import RunOutcome

WIRE = Path(__file__).parents[4] / "examples" / "configurations" / "wire.toml"


NO_CELL = ("--camera", "realsense", "--driver", "kinematic")


def _args(*arguments: str) -> ShapingArgs:
    args = parse(["bench", "shaping", *arguments])
    assert isinstance(args, ShapingArgs)
    return args


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--seeds", "0"), "--seeds 0"),
        (("--seed", "3"), "--seed has no effect.*--first-seed"),
        (("--goal=my.csv",), "--goal has no effect.*--suite goals FILE"),
        (("--jobs", "0"), "--jobs 0"),
        (("--first-seed", "9999", "--seeds", "2"), "below 10000"),
        (("--oracle", "--observer", "map"), "omit --observer map"),
        (("--randomised", "--cell.randomised", "light"), "omit it"),
        (("--planner", "crystal_ball"), "farthest"),
        (("--suite", "ropes"), "paper, goals, stiffness, wires"),
        (("--suite", "goals"), "needs a file"),
        (("--suite", "goals", "a.npy", "b.npy"), "at most one file"),
        (("--cluster", "localhost"), "no address"),
        (("--camera", "recorded"), "does not see the simulated cell"),
        (("--driver", "kinematic"), "does not move the arm of the simulated cell"),
        ((*NO_CELL, "--oracle"), "--oracle needs its ground truth"),
        ((*NO_CELL, "--randomised"), "--randomised draws"),
        ((*NO_CELL, "--jobs", "2"), "with one arm"),
        ((*NO_CELL, "--suite", "wires"), "changes the DLO"),
    ],
)
def test_invalid_arguments_are_one_clear_error_and_leave_no_folder(
    tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    folder = tmp_path / "sweep"

    with pytest.raises(ConfigError, match=message):
        run_shaping(_args(*arguments, "--out", str(folder)))

    assert not folder.exists()


def test_a_json_file_in_a_missing_folder_is_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        run_shaping(_args("--json", str(tmp_path / "missing" / "figures.json"), "--out", str(tmp_path / "sweep")))

    assert not (tmp_path / "sweep").exists()


def test_settings_of_a_file_apply_unless_the_command_line_overrides_them() -> None:
    args = _args("--config", str(WIRE), "--seeds", "2", "--model.yield-curvature-1-m", "2.0")

    assert args.seeds == 2
    assert args.run.task.learn
    assert args.run.task.infeasible == "try"
    assert args.run.model.bending_stiffness_n_m2 > 10.0 * RunConfig().model.bending_stiffness_n_m2
    assert args.run.model.yield_curvature_1_m == 2.0


def test_settings_of_a_run_are_settings_of_all_and_goals_that_may_not_hold_are_tried() -> None:
    args = _args("--suite", "wires", "--threshold-m", "0.006")

    assert args.run.task.threshold_m == 0.006
    assert args.run.task.infeasible == "try"
    assert not args.run.record


def test_the_line_of_a_run_without_a_cell_calls_its_error_an_estimate() -> None:
    judged = done(run([0.05, 0.010], true_m=0.011))
    alone = replace(judged, result=msgspec.structs.replace(judged.result, true_rmse_m=None))

    assert "RMSE  10.0 mm  true  11.0 mm" in line_of(judged)
    assert "RMSE  10.0 mm  by own estimate" in line_of(alone)
    assert "simulated" not in line_of(alone)


def test_quick_suites_are_small_enough_for_a_quarter_of_an_hour() -> None:
    # Two planners, 15 s per run of the rope and 30 s of a wire (a chain), two runs in parallel.
    for name in SUITE_NAMES:
        if name != "goals":
            runs = 2 * QUICK_SEEDS[name] * len(suite_of(name, None, quick=True))
            assert runs * (30.0 if name == "wires" else 15.0) / 2 < 15 * 60.0


def test_a_sweep_that_ctrl_c_ends_says_at_once_what_happens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(case: ShapingCase, config: RunConfig, folder: Path, own: OwnStrategies, watch: Watcher) -> CaseResult:
        watch.stopping("SIGINT (Ctrl-C)")
        assert "SIGINT (Ctrl-C): the arms brake, the running case is dropped" in capsys.readouterr().out
        return done(run([0.05], outcome=RunOutcome.CANCELLED))

    monkeypatch.setattr(sweep, "attempt_case", stopped)
    args = parse(["bench", "shaping", "--quick", "--jobs", "1", "--out", str(tmp_path / "sweep")])
    assert isinstance(args, ShapingArgs)
    with pytest.raises(KeyboardInterrupt):
        run_shaping(args)
    assert "the same command with --out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("suite", "runs", "jobs", "said"),
    [
        ("paper", 15, 2, "about 2 min on 2 idle cores"),
        ("paper", 1, 1, "about 1 min on an idle core"),
        ("goals", 1000, 1, "about 3.9 h on an idle core"),
        ("wires", 15, 1, "about 7 min on an idle core"),
    ],
)
def test_a_suite_whose_runs_were_measured_says_how_long_it_takes(suite: str, runs: int, jobs: int, said: str) -> None:
    assert expected_duration(suite, runs, jobs).startswith(said)


def test_a_suite_that_was_not_measured_promises_nothing() -> None:
    assert expected_duration("pegs", 15, 1) == ""
