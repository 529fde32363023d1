"""Rods of known shape and the clouds a stereo camera would see of them."""

import numpy as np
from scipy.interpolate import CubicSpline

from dlokit.geometry import arc_lengths, resample
from dlokit.skills.observer.anchored import chain
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.observation import Observation

LENGTH_M = 0.5
NODES = 31


def rod(xy: Float64Array, count: int = NODES) -> Float64Array:
    """A curve in the plane as nodes (count, 3) [m] of a 0.5 m rod on the table, centred at (0.5, 0)."""
    xyz = resample(np.column_stack([xy, np.zeros(len(xy))]), 400)
    xyz = (xyz - xyz.mean(axis=0)) * LENGTH_M / arc_lengths(xyz)[-1] + [0.5, 0.0, 0.004]
    return resample(xyz, count)


def shape(name: str, seed: int = 0) -> Float64Array:
    """I, S, U, or a smooth random curve; node 0 at its left end (larger y) where that is clear."""
    t = np.linspace(0.0, 1.0, 400)
    if name == "I":
        return rod(np.column_stack([0.0 * t, -t]))
    if name == "S":
        return rod(np.column_stack([0.15 * np.sin(2 * np.pi * t), -t]))
    if name == "U":
        a = np.linspace(0.0, np.pi, 200)
        arc = np.column_stack([-np.cos(a), -np.sin(a)])
        return rod(np.vstack([[-1.0, 1.6], arc, [1.0, 1.5]]))
    rng = np.random.default_rng(seed)
    turn = sum(rng.normal() * 9 / j * np.sin(2 * np.pi * j * t / 1.6 + rng.uniform(0, 6.28)) for j in range(1, 4))
    heading = rng.uniform(0, 6.28) + np.cumsum(turn) * LENGTH_M / 400
    nodes = rod(np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0))
    return nodes if nodes[0, 1] > nodes[-1, 1] else nodes[::-1].copy()


def hose(
    radius_m: float, seed: int = 0, points: int = 3000, along_xy: Float64Array | None = None
) -> tuple[Float64Array, Observation]:
    """The centre line (200, 3) [m] of a hose of 1 m in an S, and its surface as a camera above sees it.

    `along_xy` (K, 2): another curve, of any length.
    """
    rng, line = np.random.default_rng(seed), rod((shape("S")[:, :2] if along_xy is None else along_xy) / LENGTH_M, 200)
    line = resample((line - line.mean(axis=0)) / LENGTH_M, 200)
    s = arc_lengths(line)
    curve = CubicSpline(s, line)
    at, around = rng.uniform(0.0, s[-1], points), rng.uniform(0.0, np.pi, points)[:, None]
    along = curve(at, 1) / np.linalg.norm(curve(at, 1), axis=1, keepdims=True)
    across = np.column_stack([-along[:, 1], along[:, 0], np.zeros(points)])
    surface = curve(at) + radius_m * (np.cos(around) * across + np.sin(around) * np.array([0.0, 0.0, 1.0]))
    noisy = surface + rng.normal(0.0, 0.0008, surface.shape)
    return line, Observation(stamp_ns=1, points_world=noisy.astype(np.float32))


def cloud(
    nodes: Float64Array,
    seed: int = 0,
    *,
    count: int = 1800,
    noise_m: float = 0.002,
    outliers: float = 0.03,
    hidden: tuple[float, float] | None = None,
) -> Observation:
    """Points around the curve through the nodes with Gaussian noise, plus uniform outliers around it.

    `hidden` omits a part, given as fractions of the length.
    """
    rng = np.random.default_rng(seed)
    s = arc_lengths(nodes)
    at = rng.uniform(0.0, s[-1], count)
    if hidden is not None:
        at = at[(at < hidden[0] * s[-1]) | (at > hidden[1] * s[-1])]
    seen = CubicSpline(s, nodes)(at) + rng.normal(0.0, noise_m, (len(at), 3))
    low, high = nodes.min(axis=0) - 0.05, nodes.max(axis=0) + np.array([0.05, 0.05, 0.03])
    stray = rng.uniform(low, high, (int(outliers * count), 3))
    points = rng.permutation(np.vstack([seen, stray]))
    return Observation(stamp_ns=1_000, points_world=points.astype(np.float32))


def state(nodes: Float64Array) -> DloState:
    """The nodes as a prior."""
    return DloState(stamp_ns=0, nodes_world=nodes, topology=chain(len(nodes), LENGTH_M))
