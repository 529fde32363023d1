"""The run and its report: equal input for all methods, finished trials are kept, intervals of the results."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import numpy as np
import pytest
from cables import cable_arrays, write_cable
from counting_observer import CountingConfig
from rich.console import Console
from trials import run_plan

from dlokit.errors import EXIT_INTERRUPTED, ConfigError, InputError, MachineError
from dlokit.extras.bench.commands import observers
from dlokit.extras.bench.commands.observers import ObserversArgs, run_observers
from dlokit.extras.bench.observers import methods
from dlokit.extras.bench.observers.cases import BASE, ObserverCase
from dlokit.extras.bench.observers.clouds import Looks
from dlokit.extras.bench.observers.conditions import Conditions
from dlokit.extras.bench.observers.figures import ALL_CASES, figures
from dlokit.extras.bench.observers.methods import ObserverMethod, PycpdConfig, choose, default_name
from dlokit.extras.bench.observers.metrics import CORRELATION, FLAGGED, METRICS, Losses
from dlokit.extras.bench.observers.report import case_table, draw, metric_table, observers_json
from dlokit.extras.bench.observers.runner import (
    REHEARSED,
    THREAD_VARIABLES,
    WARM_UP_FRAMES,
    BenchPlan,
    Estimate,
    SampledTimes,
    Trial,
    follow,
    one_thread,
    rehearse,
    run_in_workers,
)
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.system.request import OwnStrategies
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

GIVEN: dict[str, list[tuple[Observation, DloState]]] = {}


@dataclass(frozen=True, kw_only=True)
class StillConfig:
    """An observer that never moves and records its input."""

    name: ClassVar[str] = "still"

    label: str = "still"

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        return Still(self.label)


class Still:
    def __init__(self, label: str) -> None:
        self._kept = GIVEN.setdefault(label, [])

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        self._kept.append((seen, prior))
        return nothing_seen(seen, prior)


def _plan(*given: ObserverMethod, seeds: int = 1, cases: tuple[ObserverCase, ...] = (BASE,)) -> BenchPlan:
    return BenchPlan(cases=cases, methods=given, seeds=seeds, frames=4)


def test_every_method_gets_the_same_clouds_and_only_pinned_ones_the_pins() -> None:
    GIVEN.clear()
    plan = _plan(
        ObserverMethod(config=StillConfig(label="a")), ObserverMethod(config=StillConfig(label="b"), pinned=True)
    )
    trials = list(run_plan(plan))
    assert [trial.method for trial in trials] == ["still", "still, pinned"]
    for (seen_a, _), (seen_b, _) in zip(GIVEN["a"], GIVEN["b"], strict=True):
        assert np.array_equal(seen_a.points_world, seen_b.points_world)
        assert seen_a.pins == ()
        assert [pin.node for pin in seen_b.pins] == [0, 49]


def test_the_first_frame_s_nodes_are_the_first_prior() -> None:
    GIVEN.clear()
    list(run_plan(_plan(ObserverMethod(config=StillConfig()))))
    truth = BASE.sequence(0, 4).nodes_world[0]
    assert np.array_equal(GIVEN["still"][WARM_UP_FRAMES][1].nodes_world, truth)
    assert len(GIVEN["still"]) == WARM_UP_FRAMES + 2 * 3, "a warm-up; three frames, alone and in the component"


def test_an_observer_that_never_moves_is_wrong_by_how_far_the_rod_moved() -> None:
    trial = next(iter(run_plan(_plan(ObserverMethod(config=StillConfig())))))
    nodes = BASE.sequence(0, 4).nodes_world
    assert trial.figures["node error"] == pytest.approx(np.linalg.norm(nodes[1:] - nodes[0], axis=2).mean())


def test_the_frames_of_a_sequence_are_never_loaded_all_at_once() -> None:
    asked: list[int] = []

    class Watched(Looks):
        def __getitem__(self, index: Any) -> Any:
            asked.append(1 if isinstance(index, int) else len(range(len(self))[index]))
            return super().__getitem__(index)

    sequence = BASE.sequence(0, 8)
    follow(sequence, Watched(sequence, BASE.conditions, 0), ObserverMethod(config=StillConfig()))
    assert max(asked) == WARM_UP_FRAMES


def test_intervals_are_over_sequences() -> None:
    trials = [
        Trial(case="base", seed=seed, method="m", frames=1000, figures={"node error": value})
        for seed, value in enumerate((0.01, 0.03))
    ]
    (row,) = figures(trials)
    assert (row.value, row.low, row.high, row.n, row.unit) == (pytest.approx(0.02), 0.01, 0.03, 2, "m")


def test_the_json_names_the_default_observer_and_all_rows() -> None:
    trials = [Trial(case="base", seed=0, method="still", frames=3, figures={"node error": 0.01})]
    plan = _plan(ObserverMethod(config=StillConfig()))
    content = msgspec.json.decode(observers_json(figures(trials), {"cores": "2"}, plan))
    assert content["bench"] == "observers"
    assert content["config"]["default"] == default_name()
    assert content["rows"] == [
        {"case": "base", "method": "still", "metric": "node error", "value": 0.01, "low": None, "high": None}
        | {"unit": "m", "n": 1}
    ]


def test_tables_have_a_dash_where_a_trial_is_missing_and_pictures_are_drawn(tmp_path: Path) -> None:
    trials = [
        Trial(case="base", seed=0, method="a", frames=3, figures={"node error": 0.01}),
        Trial(case="base", seed=0, method="a, pinned", frames=3, figures={"node error": 0.005}),
        Trial(case="other", seed=0, method="a", frames=3, figures={"node error": 0.02}),
    ]
    rows = figures(trials)
    assert list(case_table(rows, METRICS[0])) == [("base", "10.0", "5.0"), ("other", "20.0", "-")]
    assert [path.name for path in draw(rows, tmp_path)] == ["node-error.png"]


def test_built_in_observers_run_with_and_without_pins_and_peers_without() -> None:
    names = [method.name for method in choose().methods]
    assert "anchored" in names
    assert "anchored, pinned" in names
    assert "pycpd, pinned" not in names


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"nobody; choose from .*anchored.*pycpd"):
        choose(("nobody",))


def test_a_missing_peer_is_skipped_unless_it_was_requested(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(package: str) -> None:
        raise MachineError(f"The peer {package} is not installed")

    monkeypatch.setattr(methods, "imported", absent)
    choice = choose()
    assert {"pycpd", "probreg"}.isdisjoint(method.name for method in choice.methods)
    assert len(choice.omitted) == 2
    with pytest.raises(MachineError, match="not installed"):
        choose(("pycpd",))


def test_the_error_for_a_missing_package_names_its_installation() -> None:
    with pytest.raises(MachineError, match="pip install"):
        methods.imported("no_such_package_of_a_peer")  # pyright: ignore[reportPrivateUsage]  # the one place of the message


def test_pycpd_follows_a_small_shift() -> None:
    pytest.importorskip("pycpd", exc_type=ImportError)
    (trial,) = run_plan(
        _plan(ObserverMethod(config=PycpdConfig()), cases=(replace(BASE, conditions=Conditions(hidden=0.0)),))
    )
    # Within four frames hands move by a centimetre at most.
    assert trial.figures["node error"] < 0.01


def test_an_early_end_keeps_finished_trials(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    done = Trial(case="base", seed=0, method="cpd", frames=3, figures={"node error": 0.01})

    def interrupted(plan: BenchPlan, jobs: int):  # a generator of trials
        yield done
        raise KeyboardInterrupt

    monkeypatch.setattr(observers, "run_in_workers", interrupted)
    file = tmp_path / "figures.json"
    args = ObserversArgs(quick=True, methods="cpd", json=file, out=tmp_path / "out")
    assert run_observers(args) == EXIT_INTERRUPTED
    assert len(msgspec.json.decode(file.read_bytes())["rows"]) == 1


@dataclass(frozen=True, kw_only=True)
class FailingConfig:
    """A package that fails, or returns values that are not finite, at every other frame."""

    name: ClassVar[str] = "failing"

    not_finite: bool = False

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        return Failing(self.not_finite)


class Failing:
    def __init__(self, not_finite: bool) -> None:
        self._not_finite = not_finite
        self._calls = 0

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        self._calls += 1
        if self._calls % 2 == 0:
            if not self._not_finite:
                raise np.linalg.LinAlgError("singular matrix")
            return TargetPoints(
                stamp_ns=1, nodes_world=prior.nodes_world * np.nan, visible=np.ones(len(prior.nodes_world), np.bool_)
            )
        return nothing_seen(seen, prior)


@pytest.mark.parametrize("not_finite", [False, True])
def test_a_frame_at_which_a_method_fails_keeps_the_previous_answer_and_is_counted(not_finite: bool) -> None:
    (trial,) = run_plan(_plan(ObserverMethod(config=FailingConfig(not_finite=not_finite))))
    (still,) = run_plan(_plan(ObserverMethod(config=StillConfig())))
    assert trial.figures["frames without an answer"] == pytest.approx(1.0 / 3.0)
    assert trial.figures["node error"] == still.figures["node error"]


def test_a_method_s_memory_comes_back_with_the_next_frame_and_is_forgotten_after_a_failure() -> None:
    sequence = BASE.sequence(0, 6)
    counts: list[int] = []
    follow(
        sequence, Looks(sequence, BASE.conditions, 0), ObserverMethod(config=CountingConfig(fails_at=3, given=counts))
    )
    in_order = counts[WARM_UP_FRAMES::2]  # every second call is timed with the rest of the component
    assert in_order == [0, 1, 2, 0, 1]


def test_a_memory_that_is_too_large_ends_the_bench_with_its_name() -> None:
    sequence = BASE.sequence(0, 3)
    large = ObserverMethod(config=CountingConfig(numbers=100_000))
    with pytest.raises(InputError, match=r"targets of Counting are refused: memory has 800000 bytes; at most"):
        follow(sequence, Looks(sequence, BASE.conditions, 0), large)


def _lossy(seed: int, count: int, flagged: int, case: str = "base", correlation: float = 0.5) -> Trial:
    return Trial(
        case=case,
        seed=seed,
        method="m",
        frames=100,
        figures={CORRELATION: correlation},
        losses=Losses(count=count, flagged=flagged),
    )


def test_the_fraction_of_flagged_losses_has_their_number() -> None:
    rows = figures([_lossy(0, 3, 3), _lossy(1, 1, 0), _lossy(2, 0, 0)])
    (row,) = [row for row in rows if row.metric == FLAGGED]
    assert (row.value, row.n) == (0.75, 4)
    assert (row.low, row.high) == (0.0, 1.0), "resampled over the two sequences with losses"


def test_without_a_loss_or_health_there_is_no_fraction_of_flags() -> None:
    silent = Trial(case="base", seed=0, method="peer", frames=9, figures={"node error": 0.1})
    rows = figures([_lossy(0, 0, 0), silent])
    assert all(row.metric != FLAGGED for row in rows)
    assert list(metric_table(rows, "base"))[1] == ("health: rank correlation", "0.50", "-")


def test_over_all_cases_a_unit_is_a_seed() -> None:
    rows = figures([_lossy(s, 1, s, case, 0.2 + 0.4 * s) for s in (0, 1) for case in ("base", "other")])
    over_all = {row.metric: row for row in rows if row.case == ALL_CASES}
    assert (over_all[CORRELATION].value, over_all[CORRELATION].n) == (pytest.approx(0.4), 2)
    assert (over_all[FLAGGED].value, over_all[FLAGGED].n) == (0.5, 4)


def test_methods_without_health_are_not_assessed_by_it() -> None:
    assert not ObserverMethod(config=PycpdConfig()).states_trust
    (trial,) = run_plan(_plan(ObserverMethod(config=StillConfig())))
    assert trial.losses == Losses(count=0, flagged=0)


@pytest.mark.live
def test_a_worker_process_returns_equal_results_and_passes_on_errors(tmp_path: Path) -> None:
    file = write_cable(tmp_path / "cable.npz", 4)
    good = tuple(ObserverCase(name=str(share), file=file, conditions=Conditions(hidden=share)) for share in (0.0, 0.3))
    missing = ObserverCase(name="none", file=tmp_path / "none.npz")
    methods = choose(("anchored",)).methods[:1]
    plan = BenchPlan(cases=good, methods=methods, seeds=1, frames=None)
    there = [said for said in run_in_workers(plan, 1) if isinstance(said, Trial)]
    node_errors = [{trial.case: trial.figures["node error"] for trial in trials} for trials in (there, run_plan(plan))]
    assert len(there) == 2
    assert node_errors[0] == node_errors[1]

    with pytest.raises(InputError, match="does not exist"):
        list(run_in_workers(replace(plan, cases=(*good, missing)), 1))


def test_processes_are_started_with_one_thread_for_linear_algebra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    with one_thread():
        assert [os.environ[name] for name in THREAD_VARIABLES] == ["1"] * len(THREAD_VARIABLES)
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "NUMBA_NUM_THREADS" not in os.environ


def test_a_case_that_needs_more_frames_is_skipped_and_named() -> None:
    plan, omitted = observers._plan(ObserversArgs(frames=30))  # pyright: ignore[reportPrivateUsage]
    assert all(case.conditions.dark_s == 0.0 for case in plan.cases)
    assert any("dark for 1 s" in reason for reason in omitted)
    plan, _ = observers._plan(ObserversArgs(quick=True))  # pyright: ignore[reportPrivateUsage]
    assert any(case.conditions.dark_s == 1.0 for case in plan.cases)


def test_no_processes_at_all_are_refused() -> None:
    with pytest.raises(ConfigError, match="--jobs is 0"):
        run_observers(ObserversArgs(jobs=0))


@pytest.mark.parametrize("args", [ObserversArgs(seeds=0), ObserversArgs(frames=1), ObserversArgs(seeds=2000)])
def test_invalid_numbers_are_refused(args: ObserversArgs) -> None:
    with pytest.raises(ConfigError, match="--seeds"):
        run_observers(args)


def test_methods_of_the_user_come_first_then_those_asked_for_in_their_order() -> None:
    with OwnStrategies(observers={"mine": StillConfig()}).known():
        every = [method.name for method in choose().methods]
        chosen = [method.name for method in choose(("spr", "map", "mine")).methods]
    assert every[:4] == ["mine", "mine, pinned", "map", "map, pinned"]
    assert chosen == ["mine", "mine, pinned", "spr", "spr, pinned", "map", "map, pinned"]


def test_the_estimate_counts_frames_points_and_each_sequence_once() -> None:
    sampled = SampledTimes(sequence_s=2.0, look_s=0.01, frame_s=0.1)
    plan = BenchPlan(cases=(BASE, BASE), methods=(), seeds=3, frames=24)
    assert sampled.duration_s(plan) == pytest.approx(3 * (2 * 24 * 0.11 + 2.0 * (1.0 + (24 - REHEARSED) / 20.0)))
    dense = replace(BASE, conditions=Conditions(points=2000))
    more = SampledTimes(sequence_s=0.0, look_s=0.0, frame_s=0.1).duration_s(replace(plan, cases=(dense,)))
    assert more == pytest.approx(3 * 24 * 0.2)


def test_a_few_frames_are_rehearsed_with_every_method() -> None:
    methods = (ObserverMethod(config=StillConfig(label="a")), ObserverMethod(config=StillConfig(label="b")))
    GIVEN.clear()
    found = rehearse(BenchPlan(cases=(BASE,), methods=methods, seeds=1, frames=50))
    assert min(found.sequence_s, found.look_s, found.frame_s) > 0.0
    assert len(GIVEN["a"]) == len(GIVEN["b"]) == 2 * (WARM_UP_FRAMES + 2 * (REHEARSED - 1))


def scripted(plan: BenchPlan, jobs: int) -> Iterator[Estimate | Trial]:
    """The trials of a plan, run in this process, after an estimate of 100 s."""
    yield Estimate(seconds=100.0)
    yield from run_plan(plan)


@pytest.mark.parametrize("held", [True, False])
def test_only_of_sequences_with_pins_there_are_pinned_rows(
    held: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(observers, "run_in_workers", scripted)
    arrays = cable_arrays(4)
    np.savez(tmp_path / "cable.npz", **{name: of for name, of in arrays.items() if held or name != "pins"})
    args = ObserversArgs(methods="map", sequence=((tmp_path / "cable.npz",),), out=tmp_path / "out")
    assert run_observers(args) == 0
    said = capsys.readouterr().out
    assert ("map, pinned" in said) == held
    assert f"{8 if held else 4} trials" in said


@pytest.mark.parametrize("with_bars", [False, True])
def test_the_command_estimates_its_time_prints_each_table_once_and_the_limits_only_on_request(
    with_bars: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(observers, "run_in_workers", scripted)
    args = ObserversArgs(
        seeds=1, frames=4, methods="map,cpd", cases=("base", "hidden 50 %"), bars=with_bars, out=tmp_path / "out"
    )
    assert run_observers(args) == 0
    said = capsys.readouterr().out
    assert said.startswith("about 2 min: 8 trials, 2 sequences for each of map; map, pinned; cpd; cpd, pinned")
    assert said.count("node error, mm") == said.count("every metric") == 1
    assert ("bars, default observer map" in said) is with_bars
    assert ("against the best peer" in said) is with_bars
    assert "hidden 70 %" not in said


def test_of_a_single_case_there_is_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observers, "run_in_workers", scripted)
    args = ObserversArgs(seeds=1, frames=4, methods="map", cases=("base",), out=tmp_path / "out")
    text = StringIO()
    found, _ = observers.compare_observers(args, Console(file=text))
    assert "every metric" not in text.getvalue(), "the library's caller prints the result"
    assert str(found).count("node error mm") == 1
    assert "node error, mm" not in str(found)


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (ObserversArgs(cases=("bsae",)), r"There is no case 'bsae'; choose from 'base', 'hidden 0 %', "),
        (ObserversArgs(cases=("base",), sequence=((Path("a.npz"),),)), "--cases are of simulated sequences"),
        (ObserversArgs(cases=("dark for 1 s",), frames=10), "'dark for 1 s': 10 frames are too few"),
    ],
)
def test_cases_that_cannot_be_run_are_refused(args: ObserversArgs, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        run_observers(args)
