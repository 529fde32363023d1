"""Rods that cross themselves, and clouds of them with gaps: for ordering without a prior."""

from dataclasses import dataclass

import numpy as np

from dlokit.geometry import resample
from dlokit.types.arrays import Float64Array
from dlokit.types.observation import Observation

LENGTH_M = 0.5
RADIUS_M = 0.004
FINE = 501
TIGHTEST_M = 0.035  # bends of a rope of 8 mm that friction can hold
SHALLOWEST = np.radians(30)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A class of scenes."""

    crossings: int = 0
    gaps: int = 0
    """Number of hidden parts; together 10 % of the length."""
    outliers: float = 0.0
    spatial: bool = False
    """Whether the rod rises from the table, with its upper part above the lower where it crosses itself."""


def tangled(scene: Scene, seed: int) -> tuple[Float64Array, Observation]:
    """A curve (FINE, 3) [m] in order, and a cloud of 500 to 2000 points of it with noise of 2 mm."""
    rng = np.random.default_rng(seed)
    curve = _placed(_with_crossings(scene.crossings, rng), rng, scene)
    return curve, _cloud(curve, scene, rng)


def crossings(xy: Float64Array) -> list[tuple[int, int, float]]:
    """Crossings of a curve in the plane: two indices and the angle between its parts."""
    step = 5
    corners = xy[::step]
    a, d = corners[:-1], np.diff(corners, axis=0)
    i, j = np.triu_indices(len(a), 2)
    r, determinant = a[j] - a[i], _cross(d[i], d[j])
    determinant = np.where(np.abs(determinant) < 1e-15, 1e-15, determinant)
    t, u = _cross(r, d[j]) / determinant, _cross(r, d[i]) / determinant
    hit = np.flatnonzero((t >= 0) & (t < 1) & (u >= 0) & (u < 1))
    sine = np.abs(determinant[hit]) / np.linalg.norm(d[i[hit]], axis=1) / np.linalg.norm(d[j[hit]], axis=1)
    angles = np.arcsin(np.minimum(sine, 1.0))
    return [(int(i[k]) * step, int(j[k]) * step, float(angle)) for k, angle in zip(hit, angles, strict=True)]


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """The vector product of vectors in the plane (n, 2), (n,)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _with_crossings(count: int, rng: np.random.Generator) -> Float64Array:
    """A random curve in the plane (FINE, 2) [m] with this number of crossings, none shallow, and no other contacts."""
    while True:
        xy = _bent(rng, turn=0.0 if count == 0 else rng.uniform(0.3, 0.8) * rng.choice([-1, 1]))
        found = crossings(xy)
        if len(found) == count and all(angle > SHALLOWEST for *_, angle in found) and _apart(xy, found):
            return xy


def _bent(rng: np.random.Generator, turn: float) -> Float64Array:
    """A smooth curve (FINE, 2) [m] that bends mostly to one side, nowhere tighter than `TIGHTEST_M`."""
    u = np.linspace(0.0, 1.0, FINE)
    wave = sum(rng.normal() / k**0.5 * np.sin(np.pi * k * u + rng.uniform(0, 2 * np.pi)) for k in range(1, 5))
    curvature = np.tanh(turn + 0.7 * wave) / TIGHTEST_M
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(curvature) * LENGTH_M / FINE
    steps = np.column_stack([np.cos(heading), np.sin(heading)])[1:] * LENGTH_M / (FINE - 1)
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def _apart(xy: Float64Array, found: list[tuple[int, int, float]]) -> bool:
    """Whether parts are closer than 16 mm only around crossings, and no tip is on one."""
    coarse = np.arange(0, FINE, 4)
    near = np.linalg.norm(xy[coarse, None] - xy[None, coarse], axis=2) < 0.016
    i, j = np.nonzero(near & (coarse[None, :] - coarse[:, None] > 60))
    for a, b in zip(coarse[i], coarse[j], strict=True):
        if not any(abs(a - p) + abs(b - q) < 80 for p, q, _ in found):
            return False
    return all(p > 25 and q < FINE - 25 for p, q, _ in found)


def _placed(xy: Float64Array, rng: np.random.Generator, scene: Scene) -> Float64Array:
    """The curve on the table around (0.5, 0), or slightly lifted, with the same length."""
    z = np.full(FINE, RADIUS_M)
    if scene.spatial:
        u = np.linspace(0.0, 1.0, FINE)
        z = z + 0.02 * (1.0 + np.sin(2 * np.pi * (u * rng.uniform(0.5, 1.5) + rng.uniform())))
        for _, upper, _ in crossings(xy):
            z = z + 2.5 * RADIUS_M * np.exp(-(((np.arange(FINE) - upper) / 30.0) ** 2))
    xyz = np.column_stack([xy - xy.mean(axis=0) + [0.5, 0.0], z])
    return resample(xyz, FINE)


def _cloud(curve: Float64Array, scene: Scene, rng: np.random.Generator) -> Observation:
    count = int(rng.integers(500, 2001))
    u = rng.uniform(0.0, 1.0, count)
    for middle in _gap_middles(scene.gaps, rng):
        u = u[np.abs(u - middle) > 0.05 / scene.gaps]
    places = np.arange(FINE) / (FINE - 1)
    seen = np.column_stack([np.interp(u, places, curve[:, axis]) for axis in range(3)])
    seen += rng.normal(0.0, 0.002, seen.shape)
    low, high = curve.min(axis=0) - 0.05, curve.max(axis=0) + np.array([0.05, 0.05, 0.03])
    stray = rng.uniform(low, high, (int(scene.outliers * count), 3))
    return Observation(stamp_ns=1_000, points_world=rng.permutation(np.vstack([seen, stray])).astype(np.float32))


def _gap_middles(gaps: int, rng: np.random.Generator) -> Float64Array:
    """Centres of the gaps as fractions of the length, away from the tips and from each other."""
    while True:
        middles = np.sort(rng.uniform(0.13, 0.87, gaps))
        if np.all(np.diff(middles) > 0.15):
            return middles


def order_error_m(nodes: Float64Array, curve: Float64Array) -> float:
    """Root mean square distance of nodes (M, 3) to their positions on the curve [m], in either order."""
    truth = resample(curve, len(nodes))
    offs = (np.linalg.norm(nodes - truth, axis=1), np.linalg.norm(nodes[::-1] - truth, axis=1))
    return min(float(np.sqrt(np.mean(off**2))) for off in offs)
