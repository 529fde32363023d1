"""External sequences: what fits is read, what does not is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dlokit.bench.observers.cases import external_cases
from dlokit.bench.observers.clouds import Conditions, looks
from dlokit.bench.observers.external import read_sequence
from dlokit.description.scene import default_calibration
from dlokit.description.shapes import builtin_shape
from dlokit.errors import InputError
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


def test_clouds_are_simulated_where_the_file_has_none(tmp_path: Path) -> None:
    path = _written(tmp_path)
    assert [case.conditions.hidden for case in external_cases((path,))] == [0.0, 0.3, 0.5, 0.7]
    assert len(looks(read_sequence(path), Conditions(hidden=0.0), 0)[0].seen.points_world) == 1000


def test_rows_of_nan_are_padding_of_clouds(tmp_path: Path) -> None:
    clouds = np.random.default_rng(0).uniform(size=(FRAMES, 20, 3))
    clouds[:, 15:] = np.nan
    path = _written(tmp_path, clouds=clouds, T_world_camera=None)
    seen = looks(read_sequence(path), Conditions(), 0)
    assert seen[2].seen.points_world == pytest.approx(clouds[2, :15].astype(np.float32))
    assert len(external_cases((path,))) == 1, "what its clouds show is as it is"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"nodes": None}, "lacks"),
        ({"rate_hz": None}, "lacks"),
        ({"speed": np.ones(3)}, "unknown"),
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
def test_what_does_not_fit_is_named(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_sequence(_written(tmp_path, **changed))


def test_a_file_that_is_missing_or_something_else_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file"):
        read_sequence(tmp_path / "none.npz")
    text = tmp_path / "text.npz"
    text.write_text("nodes")
    with pytest.raises(InputError, match="plain arrays"):
        read_sequence(text)
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, nodes=np.array([object()]), rate_hz=30.0)
    with pytest.raises(InputError, match="plain arrays"):
        read_sequence(pickled)
