"""External sequences: valid ones are read, errors in others are named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cables import LENGTH_M, cable_arrays, write_cable
from trials import run_plan

from dlokit.description.default_cameras import default_calibration
from dlokit.description.shapes import builtin_shape
from dlokit.errors import InputError
from dlokit.extras.bench.observers.cases import ObserverCase, external_cases
from dlokit.extras.bench.observers.clouds import Looks
from dlokit.extras.bench.observers.conditions import Conditions
from dlokit.extras.bench.observers.methods import choose
from dlokit.extras.bench.observers.runner import BenchPlan
from dlokit.extras.bench.observers.sequence import RADIUS_M, read_sequence, unread_arrays
from dlokit.geometry import matrix

FRAMES, NODES = 5, 12
T_WORLD_CAMERA = matrix(default_calibration().T_world_camera)


def _arrays() -> dict[str, Any]:
    nodes = np.broadcast_to(builtin_shape("S", 0.5, NODES), (FRAMES, NODES, 3)).copy()
    return {"nodes": nodes, "rate_hz": 30.0, "T_world_camera": T_WORLD_CAMERA}


def _written(tmp_path: Path, **changed: Any) -> Path:
    arrays = {name: value for name, value in (_arrays() | changed).items() if value is not None}
    path = tmp_path / "cable.npz"
    np.savez(path, **arrays)
    return path


def test_a_sequence_is_read_as_it_was_written(tmp_path: Path) -> None:
    pins = _arrays()["nodes"][:, [0, -1]]
    sequence = read_sequence(_written(tmp_path, pins=pins), 3)
    assert sequence.frames == 3
    assert sequence.rate_hz == 30.0
    assert sequence.pin_nodes == (0, NODES - 1)
    assert np.array_equal(sequence.nodes_world, _arrays()["nodes"][:3])


def test_clouds_are_simulated_if_the_file_has_none(tmp_path: Path) -> None:
    path = _written(tmp_path)
    assert [case.conditions.hidden for case in external_cases((path,))] == [0.0, 0.3, 0.5, 0.7]
    assert len(Looks(read_sequence(path), Conditions(hidden=0.0), 0)[0].seen.points_world) == 1000


def test_rows_of_nan_are_padding_of_clouds(tmp_path: Path) -> None:
    clouds = np.random.default_rng(0).uniform(size=(FRAMES, 20, 3))
    clouds[:, 15:] = np.nan
    path = _written(tmp_path, clouds=clouds, T_world_camera=None)
    seen = Looks(read_sequence(path), Conditions(), 0)
    assert seen[2].seen.points_world == pytest.approx(clouds[2, :15].astype(np.float32))
    assert len(external_cases((path,))) == 1, "what its clouds show is as it is"


def test_nodes_near_points_of_a_recorded_cloud_are_visible(tmp_path: Path) -> None:
    clouds = _arrays()["nodes"][:, :7] + [0.0, 0.0, 0.01]
    clouds[2] = np.nan
    seen = Looks(read_sequence(_written(tmp_path, clouds=clouds, T_world_camera=None)), Conditions(), 0)
    assert seen[1].visible.tolist() == [True] * 7 + [False] * 5
    assert not seen[2].visible.any(), "a frame may have no points at all"


def test_the_radius_is_the_files_or_the_default(tmp_path: Path) -> None:
    assert read_sequence(_written(tmp_path)).radius_m == RADIUS_M
    assert read_sequence(_written(tmp_path, radius_m=0.002)).radius_m == 0.002


def test_unknown_arrays_are_ignored_and_named(tmp_path: Path) -> None:
    path = _written(tmp_path, pin=np.array(["left"]))
    assert read_sequence(path).pins_world is None
    assert unread_arrays(path) == ("pin",)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"nodes": None}, "lacks"),
        ({"rate_hz": None}, "lacks"),
        ({"radius_m": -0.001}, "radius_m"),
        ({"nodes": np.zeros((FRAMES, NODES, 2))}, r"\(T, K, 3\)"),
        ({"nodes": _arrays()["nodes"][:1]}, "T >= 2"),
        ({"nodes": _arrays()["nodes"] * 1000.0}, "metres"),
        ({"nodes": np.zeros((FRAMES, NODES, 3)) + 0.5}, "coincide"),
        ({"nodes": np.full((FRAMES, NODES, 3), np.nan)}, "frame 0"),
        ({"nodes": np.full((FRAMES, NODES, 3), "a")}, "only numbers"),
        ({"clouds": np.zeros((FRAMES + 1, 9, 3))}, r"\(5, N, 3\)"),
        ({"pins": np.zeros((FRAMES, 3, 3))}, r"\(5, 2, 3\)"),
        ({"T_world_camera": 2.0 * T_WORLD_CAMERA}, "rigid"),
        ({"T_world_camera": T_WORLD_CAMERA @ np.diag([1.0, -1.0, -1.0, 1.0])}, "behind the camera"),
        ({"T_world_camera": None}, "neither clouds nor"),
        ({"rate_hz": 0.0}, "rate_hz"),
        ({"rate_hz": np.array([30.0, 30.0])}, "one number"),
    ],
)
def test_inconsistent_arrays_are_named(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_sequence(_written(tmp_path, **changed))


def test_a_missing_or_foreign_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_sequence(tmp_path / "none.npz")
    text = tmp_path / "text.npz"
    text.write_text("nodes")
    with pytest.raises(InputError, match="plain arrays"):
        read_sequence(text)
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, nodes=np.array([object()]), rate_hz=30.0)
    with pytest.raises(InputError, match="plain arrays"):
        read_sequence(pickled)


def test_a_sparse_fast_sequence_runs_unpinned_and_pinned_at_its_own_rate(tmp_path: Path) -> None:
    path = write_cable(tmp_path / "cable.npz", frames=8, rate_hz=100.0)
    methods = choose(("anchored",)).methods
    plan = BenchPlan(cases=(ObserverCase(name="cable", file=path),), methods=methods, seeds=10, frames=None)
    free, pinned = run_plan(plan)
    assert free.frames == 8, "a file has one seed, and all of its frames are run"
    # 7 frames of 10 ms: within them the cable moves by 2 cm, and an observer follows.
    assert free.figures["node error"] < 0.01
    assert pinned.figures["tip error"] < 1e-4
    stamps = [look.seen.stamp_ns for look in Looks(read_sequence(path), Conditions(), 0)]
    assert np.diff(stamps).tolist() == [10_000_000] * 7


def test_rest_lengths_add_up_to_the_cable_s_length(tmp_path: Path) -> None:
    sequence = read_sequence(write_cable(tmp_path / "cable.npz", frames=2))
    assert sequence.topology.rest_lengths_m.sum() == pytest.approx(LENGTH_M, abs=2e-5)


def test_a_sparse_sequence_with_clouds_and_no_camera_runs(tmp_path: Path) -> None:
    arrays = cable_arrays(4)
    seen = Looks(read_sequence(write_cable(tmp_path / "seen.npz", frames=4)), Conditions(hidden=0.0), 0)
    arrays["clouds"] = np.array([look.seen.points_world for look in seen])
    del arrays["T_world_camera"]
    np.savez(tmp_path / "cable.npz", **arrays)
    (case,) = external_cases((tmp_path / "cable.npz",))
    (trial, _) = run_plan(BenchPlan(cases=(case,), methods=choose(("anchored",)).methods, seeds=1, frames=None))
    assert trial.figures["node error"] < 0.01
