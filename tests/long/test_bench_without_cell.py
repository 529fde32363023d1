"""`dlokit bench shaping` on an arm and a camera of a package of its own: no cell, no truth."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import own_lab
import pytest
from installed_packages import install
from made_results import PROTECTED

from dlokit import geometry
from dlokit.description import shapes
from dlokit.system.results.run_result import protection_result, read_result

DLOKIT = str(Path(sys.executable).with_name("dlokit"))
LIMIT_S = 900.0  # two live runs, each a minute on two idle cores


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A lab whose rope lies straight."""
    install(tmp_path / "camera", "own-camera", "dlokit.cameras", {"own-camera": "own_lab:OwnCameraConfig"}, {})
    install(tmp_path / "arm", "own-arm", "dlokit.robots", {"own-arm": "own_lab:OwnArmConfig"}, {})
    np.save(tmp_path / "table.npy", shapes.builtin_shape("I", 0.5, 101))
    return tmp_path / "table.npy"


def _bench(table: Path, *arguments: str) -> str:
    packages = (table.parent / "camera", table.parent / "arm", Path(own_lab.__file__).parent)
    path = os.pathsep.join(map(str, packages))
    done = subprocess.run(
        (
            DLOKIT,
            "bench",
            "shaping",
            "--driver",
            "own-arm",
            "--camera",
            "own-camera",
            "--operator-confirms",
            *arguments,
        ),
        env={**os.environ, "PYTHONPATH": path, own_lab.TABLE: str(table)},
        cwd=table.parent,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_lab_lays_each_start_shapes_the_rope_and_is_judged_by_its_own_estimate(table: Path) -> None:
    t = np.linspace(0.0, 1.0, 50)
    np.save(table.parent / "goals.npy", np.column_stack([0.06 * np.sin(2.0 * np.pi * t), 0.5 * t, 0.0 * t])[None])
    arguments = ("--suite", "goals", "goals.npy", "--seeds", "1", "--out", "sweep", "--json", "figures.json")

    said = _bench(table, *arguments)

    assert "moves a real arm" in said
    assert "by own estimate" in said
    assert "no ground truth without a simulated cell" in said
    case = table.parent / "sweep" / "goal-0-0-rollout-map"
    with np.load(case / "shapes.npz") as drawn:
        start, goal, final = (np.array(drawn[f"{name}_world"]) for name in ("start", "goal", "final"))
    meant = geometry.resample(np.load(case / "start" / "goal.npy"), len(start))
    assert _rmse_m(start, meant) < 0.015  # the threshold, and what two looks differ by
    assert _rmse_m(final, goal) < 0.013
    # What the rope of the lab really did, which the bench cannot know.
    assert _rmse_m(geometry.resample(np.load(table), len(goal)), goal) < 0.016
    assert not list(table.parent.rglob("truth.npz"))
    results = [read_result(path.parent) for path in case.rglob("result.json")]
    assert results
    assert {result.protections for result in results} == {(protection_result(PROTECTED),)}
    figures: dict[str, Any] = msgspec.json.decode((table.parent / "figures.json").read_bytes())
    assert figures["config"]["judged_by"].startswith("the system's own estimate")
    metrics = {row["metric"] for row in figures["rows"]}
    assert "median rmse_m" in metrics
    assert not any("true" in metric or "false" in metric for metric in metrics)

    again = _bench(table, *arguments)  # the finished case is read: no arm moves

    assert "1/1 goal 0" in again


def _rmse_m(one: np.ndarray, other: np.ndarray) -> float:
    return min(geometry.rmse_m(one, other), geometry.rmse_m(one[::-1], other))
