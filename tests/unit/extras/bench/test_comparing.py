"""One's own planners and observers beside dlokit's, in the calling program."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib.externals.loky import get_reusable_executor

import dlokit
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.planning.config import PLANNERS

t = np.linspace(0.0, 1.0, 40)
ARCS = np.stack([np.column_stack([0.45 + 0.1 * np.sin(np.pi * t), 0.2 - 0.4 * t, np.zeros(40)])])

SHORT = {"task.max_actions": 1, "task.check_camera": False, "cell.settle_s": 0.5}


class TwiceFarthest:
    """Moves the node with the largest error; counts its decisions."""

    def __init__(self) -> None:
        self.decisions = 0

    def propose(self, shape: Any, goal: Any, marks: Any, tools: Any) -> Iterator[Any]:
        self.decisions += 1
        assert self.decisions < 20, "a copy is made for each run"
        error_m = np.linalg.norm(goal.nodes_world - shape.nodes_world, axis=1)
        for node in np.argsort(-error_m):
            action = tools.pick_and_place(shape, goal, int(node))
            if node not in marks.invalid_nodes and action is not None:
                yield action


def compare(planners: Any, out: Path, seeds: int = 1, **more: Any) -> Any:
    return dlokit.bench.shaping(
        planners, goals=ARCS, seeds=seeds, oracle=True, settings=SHORT, out=out, progress=False, **more
    )


def test_a_planner_of_the_program_runs_beside_an_installed_one(tmp_path: Path) -> None:
    mine = TwiceFarthest()
    comparison = compare({"mine": mine, "farthest": "farthest"}, tmp_path / "runs", json=tmp_path / "figures.json")
    by_planner = {done.case.method.planner: done for done in comparison.results}
    assert set(by_planner) == {"mine", "farthest"}
    for done in by_planner.values():
        assert done.fault is None
        assert done.result.actions >= 1
    assert mine.decisions == 0
    assert "mine" not in PLANNERS.installed()
    assert 'kind = "mine"' in next((tmp_path / "runs").glob("*mine*/config.toml")).read_text()
    assert (tmp_path / "figures.json").is_file()
    assert "mine" in str(comparison)
    assert {figure.method for figure in comparison.figures} >= {"mine, ideal", "farthest, ideal"}


def test_it_runs_inside_an_event_loop(tmp_path: Path) -> None:
    async def main() -> Any:
        return compare({"mine": TwiceFarthest()}, tmp_path / "runs")

    (done,) = asyncio.run(main()).results
    assert done.fault is None
    assert done.result.actions == 1


@pytest.fixture
def no_workers_left() -> Iterator[None]:
    """Ends joblib's processes, which otherwise wait minutes for more work."""
    yield
    get_reusable_executor().shutdown(wait=True, kill_workers=True)


@pytest.mark.live
@pytest.mark.usefixtures("no_workers_left")
def test_it_runs_in_processes_as_in_this_one(tmp_path: Path) -> None:
    one = compare({"mine": TwiceFarthest()}, tmp_path / "one")
    two = compare({"mine": TwiceFarthest()}, tmp_path / "two", jobs=2, seeds=2)
    assert [len(one.results), len(two.results)] == [1, 2]
    assert one.results[0].result.rmse_m == next(d for d in two.results if d.case.seed == 0).result.rmse_m


def test_what_a_planner_raises_is_a_fault_that_names_it(tmp_path: Path) -> None:
    class Broken:
        def propose(self, shape: Any, goal: Any, marks: Any, tools: Any) -> list[Any]:
            return [None]

    (done,) = compare({"broken": Broken()}, tmp_path / "runs").results
    assert "'broken' proposed None" in (done.fault or "") + (done.result.reason or "")


@pytest.mark.parametrize(
    ("planners", "told"),
    [
        ({"mine": TwiceFarthest}, "give an object"),
        ({"mine": 3}, "give an object"),
        ({"rollout": TwiceFarthest()}, "choose another name"),
        ({"a, b": TwiceFarthest()}, "not a name"),
        ({"mine": "crystal-ball"}, "choose one of"),
        (["crystal-ball"], "choose one of"),
    ],
)
def test_what_is_no_planner_is_refused_before_anything_runs(planners: Any, told: str, tmp_path: Path) -> None:
    with pytest.raises(dlokit.InputError, match=told):
        compare(planners, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_shape_takes_objects(tmp_path: Path) -> None:
    class Holding:
        def estimate(self, seen: Any, prior: Any) -> Any:
            return prior.nodes_world

    run = dlokit.shape(
        planner=TwiceFarthest(),
        observer=Holding(),
        settings={**SHORT, "record": False},
        out=tmp_path / "run",
        progress=False,
    )
    assert len(run.actions) == 1
    assert {action.kind for action in run.actions} == {"pick-and-place"}
    with pytest.raises(dlokit.InputError, match="entry point"):
        dlokit.shape(planner=TwiceFarthest(), runtime="live", out=tmp_path / "live")


@pytest.mark.live  # observers are compared in processes of their own
def test_observers_of_the_program_are_compared_on_a_sequence(tmp_path: Path) -> None:
    class Holding:
        def estimate(self, seen: Any, prior: Any) -> Any:
            return prior.nodes_world

    nodes = ARCS + np.linspace(0.0, 0.01, 6)[:, None, None] * np.array([1.0, 0.0, 0.0])
    np.savez(tmp_path / "moved.npz", nodes=nodes, clouds=nodes, rate_hz=30.0, radius_m=0.004)
    comparison = dlokit.bench.observers(
        {"mine": Holding(), "stiff": CpdConfig(beta_m=0.5)},
        sequences=[tmp_path / "moved.npz"],
        out=tmp_path / "plots",
        progress=False,
    )
    errors = {row.method: row.value for row in comparison.figures if row.metric == "node error"}
    assert {"mine", "stiff"} <= set(errors)
    assert errors["mine"] > errors["stiff"]
    assert "stiff" in str(comparison)
