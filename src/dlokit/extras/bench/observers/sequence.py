"""A moving DLO whose nodes are known at every frame, and the curve between them; also read from `.npz` files."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dlokit.errors import InputError
from dlokit.geometry import arc_lengths, rigid_pose, rotation
from dlokit.rod.believed import BelievedDlo
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.dlo import Topology
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

FINE = 401
"""Points of a centre line."""
_A_SPAN = 32  # number of chords for the length of the curve between two nodes
_LEAST_STEP_M = 1e-6  # an estimate may have nodes that coincide; a spline's parameter must grow


@dataclass(frozen=True, kw_only=True)
class CentreLine:
    """A DLO as its cameras see it."""

    points_world: Float64Array  # (FINE, 3) [m], equally spaced along the arc
    nodes_at: Int64Array  # (K,) the index into `points_world` at each node


def centre_line(nodes_world: Float64Array) -> CentreLine:
    """The curve through nodes (K, 3) [m]."""
    curve, at = _curve(nodes_world)
    t = np.linspace(0.0, at[-1], FINE)
    s = arc_lengths(curve(t))
    points = np.asarray(curve(np.interp(np.linspace(0.0, s[-1], FINE), s, t)), dtype=np.float64)
    return CentreLine(
        points_world=points,
        nodes_at=np.rint(np.interp(at, t, s) / s[-1] * (FINE - 1)).astype(np.int64),
    )


def smooth_line(nodes_world: Float64Array, count: int) -> Float64Array:
    """About `count` points (N, 3) [m] of the curve through nodes (K, 3) [m]; every node is one of them."""
    each = max(1, round(count / (len(nodes_world) - 1)))
    if each == 1:
        return nodes_world
    curve, at = _curve(nodes_world)
    return np.asarray(curve(_divided(at, each)), dtype=np.float64)


def lengths_between_m(nodes_world: Float64Array) -> Float64Array:
    """Lengths (K-1,) [m] of the curve between neighbouring nodes (K, 3) [m]; chords are shorter where it bends."""
    curve, at = _curve(nodes_world)
    return np.diff(arc_lengths(curve(_divided(at, _A_SPAN)))[::_A_SPAN])


def _curve(nodes_world: Float64Array) -> tuple[CubicSpline, Float64Array]:
    steps = np.linalg.norm(np.diff(nodes_world, axis=0), axis=1)
    at = np.concatenate(([0.0], np.cumsum(np.maximum(steps, _LEAST_STEP_M))))
    return CubicSpline(at, nodes_world), at


def _divided(at: Float64Array, each: int) -> Float64Array:
    """Every span of the parameter (K,) in `each` parts, ((K-1) each + 1,)."""
    return np.interp(np.arange((len(at) - 1) * each + 1) / each, np.arange(len(at)), at)


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """Ground truth: T frames of K nodes, in the world frame. Observers start from the first frame."""

    name: str
    rate_hz: float
    nodes_world: Float64Array  # (T, K, 3) [m]; NaN where they are unknown, never in the first frame
    radius_m: float
    """Radius of the DLO [m]: clouds show its surface."""
    pin_nodes: tuple[int, ...] = ()
    """Nodes that a gripper holds at some time, P of them."""
    pins_world: Float64Array | None = None  # (T, P, 3) [m] where grippers hold them; NaN while they do not
    T_world_camera: Pose | None = None
    """Pose of the camera; None if it is unknown, for a sequence with its own clouds."""
    clouds_world: NDArray[np.floating] | None = None  # (T, N, 3) [m], rows of NaN are padding; None: simulated
    calibration: CameraCalibration | None = None
    """The camera that took the clouds, where it is known."""

    @property
    def frames(self) -> int:
        """T."""
        return len(self.nodes_world)

    @property
    def count(self) -> int:
        """K."""
        return self.nodes_world.shape[1]

    @property
    def dlo(self) -> BelievedDlo:
        """The DLO, as measured with a ruler."""
        length_m = float(self.topology.rest_lengths_m.sum())
        return BelievedDlo(nodes=self.count, length_m=length_m, radius_m=self.radius_m)

    @property
    def topology(self) -> Topology:
        """The rod's edges, each as long as the curve of the first frame is between its nodes."""
        first = np.arange(self.count - 1)
        return Topology(
            edges=np.column_stack([first, first + 1]).astype(np.int64),
            rest_lengths_m=lengths_between_m(self.nodes_world[0]),
        )


RADIUS_M = BelievedDlo.radius_m
"""Assumed radius of a DLO whose nodes alone are known [m]."""
_LARGEST_M = 20.0  # no DLO in view is farther from the origin; coordinates in millimetres are
_THICKEST_M = 0.1
_NEEDED = ("nodes", "rate_hz")
_UNREADABLE = (ValueError, EOFError, OSError, zipfile.BadZipFile, AttributeError)
_OPTIONAL = ("clouds", "pins", "T_world_camera", "radius_m")


def read_sequence(path: Path, frames: int | None = None) -> Sequence:
    """Read a sequence from a file, limited to its first `frames` frames.

    Arrays: `nodes` (T, K, 3) [m], `rate_hz`; optionally `clouds` (T, N, 3) [m] with NaN rows as padding, `pins`
    (T, 2, 3) [m] of the first and the last node, `T_world_camera` (4, 4), `radius_m`. Further arrays are not read.
    Raises `InputError` that names the mismatch.
    """
    arrays = _load(path)
    nodes = _nodes(arrays, path)[:frames]
    count = len(nodes)
    clouds = _clouds(arrays, path)
    pins = arrays["pins"].astype(np.float64) if "pins" in arrays else None
    if pins is not None and pins.shape != (len(arrays["nodes"]), 2, 3):
        raise InputError(f"{path}: pins is {pins.shape}; it must be {(len(arrays['nodes']), 2, 3)}.")
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
    """Names of arrays in a file that are not part of a sequence, perhaps misspelt."""
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
        raise InputError(f"File {path} does not exist; --sequence takes .npz files.") from None
    except _UNREADABLE as error:
        raise InputError(f"{path} is not a .npz file of plain arrays ({error}): write it with numpy.savez.") from error
    missing = [name for name in _NEEDED if name not in arrays]
    if missing:
        raise InputError(
            f"{path} lacks {' and '.join(missing)}: nodes and rate_hz are required, "
            f"{', '.join(_OPTIONAL)} are optional."
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
    # In the file's precision: thousands of frames in float32 would take twice the memory in float64.
    return clouds if clouds.dtype.kind == "f" else clouds.astype(np.float32)


def _camera(arrays: dict[str, np.ndarray], path: Path) -> Pose | None:
    if "T_world_camera" not in arrays:
        return None
    pose = rigid_pose(arrays["T_world_camera"], f"{path}: T_world_camera")
    depth = ((arrays["nodes"].reshape(-1, 3) - pose.position_m) @ rotation(pose))[:, 2]
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
