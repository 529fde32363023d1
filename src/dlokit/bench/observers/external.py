"""External sequences: `.npz` files with the true nodes of a DLO, and perhaps its clouds."""

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlokit.bench.observers.sequence import Sequence
from dlokit.errors import InputError
from dlokit.geometry import pose_from_matrix
from dlokit.rod.believed import BelievedDlo
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

RADIUS_M = BelievedDlo.radius_m
"""Radius taken for a DLO of which only the nodes are known [m]."""
_LARGEST_M = 20.0  # nothing a camera sees of a DLO is further from the origin; millimetres are
_THICKEST_M = 0.1
_NEEDED = ("nodes", "rate_hz")
_UNREADABLE = (ValueError, EOFError, OSError, zipfile.BadZipFile, AttributeError)
_OPTIONAL = ("clouds", "pins", "T_world_camera", "radius_m")


def read_sequence(path: Path, frames: int | None = None) -> Sequence:
    """A sequence from a file, its first `frames` frames.

    Arrays: `nodes` (T, K, 3) [m], `rate_hz`; optionally `clouds` (T, N, 3) [m] with NaN rows as padding, `pins`
    (T, 2, 3) [m] of the first and the last node, `T_world_camera` (4, 4), `radius_m`. Others are not read. Raises
    `InputError` that says what does not fit.
    """
    arrays = _load(path)
    nodes = _nodes(arrays, path)[:frames]
    count = len(nodes)
    clouds = _clouds(arrays, path)
    pins = _shaped(arrays, "pins", (len(arrays["nodes"]), 2, 3), path)
    camera = _camera(arrays, path)
    if clouds is None and camera is None:
        raise InputError(
            f"{path} has neither clouds nor T_world_camera (4, 4): without a camera clouds cannot be simulated; "
            "add one of them."
        )
    return Sequence(
        name=path.stem,
        rate_hz=_number(arrays["rate_hz"], "rate_hz", 10_000.0, path),
        nodes_world=nodes,
        radius_m=_number(arrays["radius_m"], "radius_m", _THICKEST_M, path) if "radius_m" in arrays else RADIUS_M,
        pin_nodes=() if pins is None else (0, nodes.shape[1] - 1),
        pins_world=None if pins is None else pins[:count],
        T_world_camera=camera,
        clouds_world=None if clouds is None else clouds[:count],
    )


def unread_arrays(path: Path) -> tuple[str, ...]:
    """The arrays of a file that are none of a sequence's: perhaps a name that was misspelt."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return tuple(name for name in file.files if name not in (*_NEEDED, *_OPTIONAL))
    except _UNREADABLE:
        return ()


def _load(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in (*_NEEDED, *_OPTIONAL) if name in file.files}
    except FileNotFoundError:
        raise InputError(f"There is no file {path}; --sequence takes .npz files.") from None
    except _UNREADABLE as error:
        raise InputError(f"{path} is no .npz file of plain arrays ({error}): write it with numpy.savez.") from error
    missing = [name for name in _NEEDED if name not in arrays]
    if missing:
        raise InputError(
            f"{path} lacks {' and '.join(missing)}: needed are nodes and rate_hz, "
            f"allowed besides are {', '.join(_OPTIONAL)}."
        )
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu":
            raise InputError(f"{path}: {name} holds {array.dtype}; only numbers are allowed.")
    return arrays


def _nodes(arrays: dict[str, np.ndarray], path: Path) -> Float64Array:
    nodes = arrays["nodes"].astype(np.float64)
    if nodes.ndim != 3 or nodes.shape[2] != 3 or nodes.shape[0] < 2 or nodes.shape[1] < 3:
        raise InputError(f"{path}: nodes is {nodes.shape}; it must be (T, K, 3) with T >= 2 frames and K >= 3 nodes.")
    if not np.all(np.isfinite(nodes)):
        frame = int(np.argmin(np.all(np.isfinite(nodes), axis=(1, 2))))
        raise InputError(f"{path}: nodes of frame {frame} are not finite; ground truth has no gaps: cut or fill them.")
    if np.abs(nodes).max() > _LARGEST_M:
        raise InputError(
            f"{path}: nodes reach {np.abs(nodes).max():.0f} m; they must be in metres, at most {_LARGEST_M:.0f}."
        )
    if np.linalg.norm(np.diff(nodes, axis=1), axis=2).min() < 1e-6:
        raise InputError(f"{path}: two neighbouring nodes coincide; every edge of the DLO needs a length.")
    return nodes


def _clouds(arrays: dict[str, np.ndarray], path: Path) -> NDArray[np.floating] | None:
    if "clouds" not in arrays:
        return None
    clouds = arrays["clouds"]
    frames = len(arrays["nodes"])
    if clouds.ndim != 3 or clouds.shape[::2] != (frames, 3):
        raise InputError(f"{path}: clouds is {clouds.shape}; it must be ({frames}, N, 3), padded with NaN rows.")
    # As they are in the file: thousands of frames in float32 would take twice the room in float64.
    return clouds if clouds.dtype.kind == "f" else clouds.astype(np.float32)


def _camera(arrays: dict[str, np.ndarray], path: Path) -> Pose | None:
    T = _shaped(arrays, "T_world_camera", (4, 4), path)
    if T is None:
        return None
    R = T[:3, :3]
    rigid = np.allclose(R @ R.T, np.eye(3), atol=1e-3) and np.linalg.det(R) > 0.0
    if not rigid or not np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], atol=1e-9):
        raise InputError(
            f"{path}: T_world_camera is no rigid transform; it must be a rotation and a position in metres, "
            "p_world = T_world_camera p_camera."
        )
    pose = pose_from_matrix(T)
    depth = (arrays["nodes"].reshape(-1, 3) - T[:3, 3]) @ R[:, 2]
    if depth.min() < 0.05:
        raise InputError(
            f"{path}: nodes lie behind the camera or nearer than 5 cm (depth {depth.min():.2f} m); camera frames are "
            "x right, y down, z forward: check T_world_camera, it may be inverted."
        )
    return pose


def _number(array: np.ndarray, name: str, most: float, path: Path) -> float:
    if array.size != 1 or not np.isfinite(array.item()) or not 0.0 < float(array.item()) <= most:
        raise InputError(f"{path}: {name} is {array}; it must be one number above 0 and at most {most:g}.")
    return float(array.item())


def _shaped(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...], path: Path) -> Float64Array | None:
    if name not in arrays:
        return None
    array = arrays[name].astype(np.float64)
    if array.shape != shape:
        raise InputError(f"{path}: {name} is {array.shape}; it must be {shape}.")
    return array
