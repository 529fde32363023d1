"""The run and its report: the same input for all, what was done is kept, figures with intervals."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from dlokit.app import bench_observers
from dlokit.app.bench_observers import ObserversArgs, run_observers
from dlokit.bench.observers import peers
from dlokit.bench.observers.cases import BASE, Case
from dlokit.bench.observers.clouds import Conditions
from dlokit.bench.observers.methods import Method, choose, default_name
from dlokit.bench.observers.metrics import METRICS
from dlokit.bench.observers.peers import PycpdConfig
from dlokit.bench.observers.report import case_table, draw, figures, observers_json
from dlokit.bench.observers.runner import Plan, Trial, run_plan
from dlokit.errors import ConfigError, MachineError
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

GIVEN: dict[str, list[tuple[Observation, DloState]]] = {}


@dataclass(frozen=True, kw_only=True)
class StillConfig:
    """An observer that never moves and keeps what it was given."""

    name: ClassVar[str] = "still"

    label: str = "still"

    def build(self) -> ObserverStrategy:
        return Still(self.label)


class Still:
    def __init__(self, label: str) -> None:
        self._kept = GIVEN.setdefault(label, [])

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        self._kept.append((seen, prior))
        return nothing_seen(seen, prior)


def _plan(*given: Method, seeds: int = 1, cases: tuple[Case, ...] = (BASE,)) -> Plan:
    return Plan(cases=cases, methods=given, seeds=seeds, frames=4)


def test_every_method_gets_the_same_clouds_and_only_pinned_ones_the_pins() -> None:
    GIVEN.clear()
    plan = _plan(Method(config=StillConfig(label="a")), Method(config=StillConfig(label="b"), pinned=True))
    trials = list(run_plan(plan))
    assert [trial.method for trial in trials] == ["still", "still, pinned"]
    for (seen_a, _), (seen_b, _) in zip(GIVEN["a"][1:], GIVEN["b"][1:], strict=True):  # [0] is the warm-up
        assert np.array_equal(seen_a.points_world, seen_b.points_world)
        assert seen_a.pins == ()
        assert [pin.node for pin in seen_b.pins] == [0, 49]


def test_the_first_frame_s_nodes_are_the_first_prior() -> None:
    GIVEN.clear()
    list(run_plan(_plan(Method(config=StillConfig()))))
    truth = BASE.sequence(0, 4).nodes_world[0]
    assert np.array_equal(GIVEN["still"][1][1].nodes_world, truth)
    assert len(GIVEN["still"]) == 4, "one warm-up and three frames after the first"


def test_an_observer_that_never_moves_is_wrong_by_how_far_the_rod_moved() -> None:
    trial = next(iter(run_plan(_plan(Method(config=StillConfig())))))
    nodes = BASE.sequence(0, 4).nodes_world
    assert trial.figures["node error"] == pytest.approx(np.linalg.norm(nodes[1:] - nodes[0], axis=2).mean())


def test_intervals_are_over_sequences() -> None:
    trials = [
        Trial(case="base", seed=seed, method="m", frames=1000, figures={"node error": value})
        for seed, value in enumerate((0.01, 0.03))
    ]
    (row,) = figures(trials)
    assert (row.value, row.low, row.high, row.n, row.unit) == (pytest.approx(0.02), 0.01, 0.03, 2, "m")


def test_the_json_names_the_default_observer_and_all_rows() -> None:
    trials = [Trial(case="base", seed=0, method="still", frames=3, figures={"node error": 0.01})]
    plan = _plan(Method(config=StillConfig()))
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


def test_ours_run_without_and_with_pins_and_peers_without() -> None:
    names = [method.name for method in choose().methods]
    assert "anchored" in names
    assert "anchored, pinned" in names
    assert "pycpd, pinned" not in names


def test_an_unknown_method_is_named_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match=r"nobody; there are .*anchored.*pycpd"):
        choose(("nobody",))


def test_a_missing_peer_is_left_out_unless_it_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(package: str) -> None:
        raise MachineError(f"The peer {package} is not installed")

    monkeypatch.setattr(peers, "imported", absent)
    choice = choose()
    assert {"pycpd", "probreg"}.isdisjoint(method.name for method in choice.methods)
    assert len(choice.left_out) == 2
    with pytest.raises(MachineError, match="not installed"):
        choose(("pycpd",))


def test_a_package_that_is_not_there_is_told_how_to_install() -> None:
    with pytest.raises(MachineError, match="pip install"):
        peers.imported("no_such_package_of_a_peer")  # pyright: ignore[reportPrivateUsage]  # the one place of the message


def test_pycpd_follows_a_small_shift() -> None:
    pytest.importorskip("pycpd", exc_type=ImportError)
    (trial,) = run_plan(_plan(Method(config=PycpdConfig()), cases=(replace(BASE, conditions=Conditions(hidden=0.0)),)))
    # Within four frames hands move by a centimetre at most.
    assert trial.figures["node error"] < 0.01


def test_an_early_end_keeps_what_was_done(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    done = Trial(case="base", seed=0, method="cpd", frames=3, figures={"node error": 0.01})

    def interrupted(plan: Plan):  # a generator of trials
        yield done
        raise KeyboardInterrupt

    monkeypatch.setattr(bench_observers, "run_plan", interrupted)
    file = tmp_path / "figures.json"
    assert run_observers(ObserversArgs(quick=True, methods="cpd", json=file, out=tmp_path / "out")) == 0
    assert len(msgspec.json.decode(file.read_bytes())["rows"]) == 1


@pytest.mark.parametrize("args", [ObserversArgs(seeds=0), ObserversArgs(frames=1), ObserversArgs(seeds=2000)])
def test_numbers_that_cannot_be_are_refused(args: ObserversArgs) -> None:
    with pytest.raises(ConfigError, match="--seeds"):
        run_observers(args)
