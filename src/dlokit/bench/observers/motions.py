"""The motions of the bench's own sequences: what the hands do, drawn from a seed.

Speeds are those of the fastest hand. Every script is for its full speed; `Stage.record` plays it slower.
"""

from collections.abc import Callable

import numpy as np

from dlokit.bench.observers.stage import MovingHand, Phase, Script
from dlokit.description.shapes import RANDOM_X_M, RANDOM_Y_M
from dlokit.errors import ConfigError
from dlokit.geometry import arc_lengths, resample
from dlokit.types.arrays import Float64Array

LIFT_M = 0.05
"""How high a rod's node is lifted to be carried [m]."""
LONGEST_CARRY_M = 0.20
SWING_RAD_S = 5.0
"""Rate of a swing [rad/s]: well below that of the hanging rod itself, or it would loop."""
_LOOP_CENTRE_M = (0.52, 0.03)
_REST_S = 0.2
_SECONDS = np.linspace(0.0, 4.0, 1601)  # where speeds are measured: a full sequence
_ATTEMPTS = 1000
_LOW = np.array([0.36, -0.22, 0.22])  # hands in the air stay in here: the camera sees all of the rod
_HIGH = np.array([0.68, 0.26, 0.40])


def hanging(length_m: float, count: int, span_m: float) -> Float64Array:
    """A rod hanging from two hands in the air `span_m` apart, as a parabola of its length, (count, 3) [m]."""
    ends = np.array([[0.52, 0.06 - span_m / 2.0, 0.32], [0.52, 0.06 + span_m / 2.0, 0.32]])
    t = np.linspace(0.0, 1.0, 401)
    chord = ends[0] + t[:, None] * (ends[1] - ends[0])

    def sagging(sag_m: float) -> Float64Array:
        return chord - 4.0 * sag_m * (t * (1.0 - t))[:, None] * np.array([0.0, 0.0, 1.0])

    low_m, high_m = 0.0, length_m
    for _ in range(60):
        sag_m = (low_m + high_m) / 2.0
        low_m, high_m = (sag_m, high_m) if arc_lengths(sagging(sag_m))[-1] < length_m else (low_m, sag_m)
    return resample(sagging(high_m), count)


def loop(rng: np.random.Generator, length_m: float, count: int, radius_m: float) -> Float64Array:
    """A rod on the table as an open loop of 260°, turned at random, (count, 3) [m]."""
    angle = np.linspace(0.0, np.deg2rad(260.0), 401) + rng.uniform(-np.pi, np.pi)
    size_m = length_m / np.deg2rad(260.0)
    circle = size_m * np.column_stack([np.cos(angle), np.sin(angle)])
    return resample(np.column_stack([circle + _LOOP_CENTRE_M, np.full(len(angle), radius_m)]), count)


def two_hands(rng: np.random.Generator, nodes: Float64Array, speed_m_s: float) -> Script:
    """Both ends are moved through the air along smooth random paths, each on its own."""
    span = nodes[-1] - nodes[0]
    for _ in range(_ATTEMPTS):
        paths = [_wander(rng), _wander(rng)]
        moved = [path(_SECONDS) for path in paths]
        factor = speed_m_s / max(_fastest(track) for track in moved)
        a, b = (node + factor * track for node, track in zip(nodes[[0, -1]], moved, strict=True))
        apart = np.linalg.norm(b - a, axis=1)
        inside = all(bool(np.all((track >= _LOW) & (track <= _HIGH))) for track in (a, b))
        if inside and apart.min() > 0.3 * np.linalg.norm(span) and apart.max() < 1.45 * np.linalg.norm(span):
            hands = tuple(
                MovingHand(node=node, offset_m=_scaled(path, factor))
                for node, path in zip((0, len(nodes) - 1), paths, strict=True)
            )
            return lambda nodes_world: Phase(duration_s=np.inf, hands=hands)
    raise ConfigError(f"No path of two hands at {speed_m_s} m/s stays in view of the camera; choose a lower speed.")


def swing(rng: np.random.Generator, nodes: Float64Array, speed_m_s: float) -> Script:
    """Both ends are swung together to and fro, across the view of the camera; the rod between them lags behind."""
    angle = rng.uniform(-0.5, 0.5) + rng.choice([0.0, np.pi])
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])

    def path(t: Float64Array) -> Float64Array:
        return _ease(t)[..., None] * np.sin(SWING_RAD_S * t)[..., None] * direction

    offset = _scaled(path, speed_m_s / _fastest(path(_SECONDS)))
    hands = tuple(MovingHand(node=node, offset_m=offset) for node in (0, len(nodes) - 1))
    return lambda nodes_world: Phase(duration_s=np.inf, hands=hands)


def pick_and_place(rng: np.random.Generator, speed_m_s: float) -> Script:
    """Random nodes of a rod on the table are picked, carried to random places, and released, one after another."""
    held = False

    def script(nodes_world: Float64Array) -> Phase:
        nonlocal held
        held = not held
        if not held:
            return Phase(duration_s=_REST_S)
        node = int(rng.integers(len(nodes_world)))
        goal = np.array([rng.uniform(*RANDOM_X_M), rng.uniform(*RANDOM_Y_M)])
        return _carry(node, goal - nodes_world[node, :2], speed_m_s)

    return script


def crossing(rng: np.random.Generator, speed_m_s: float) -> Script:
    """One end of a loop is carried over the rod near its other end and laid down beyond it, to and fro."""
    over = rng.uniform(0.78, 0.88)
    number = 0

    def script(nodes_world: Float64Array) -> Phase:
        nonlocal number
        number += 1
        if number % 2 == 0:
            return Phase(duration_s=_REST_S)
        middle = round(over * (len(nodes_world) - 1))
        along = nodes_world[middle + 1, :2] - nodes_world[middle - 1, :2]
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        way = nodes_world[middle, :2] - nodes_world[0, :2]
        beyond = across * np.copysign(0.06, way @ across)
        return _carry(0, way + beyond, speed_m_s, longest_m=np.inf)

    return script


def _carry(node: int, way_m: Float64Array, speed_m_s: float, longest_m: float = LONGEST_CARRY_M) -> Phase:
    """Lift, carry by `way_m` (2,) [m], lower; each with a speed that rises and falls smoothly to `speed_m_s`."""
    far_m = float(np.linalg.norm(way_m))
    way = way_m * min(1.0, longest_m / max(far_m, 1e-9))
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, LIFT_M], [way[0], way[1], LIFT_M], [way[0], way[1], 0.0]])
    # The smoothest profile from rest to rest has a top speed of 15/8 of its mean.
    times = np.linalg.norm(np.diff(corners, axis=0), axis=1) * 1.875 / speed_m_s
    begins = np.concatenate(([0.0], np.cumsum(times)))

    def offset_m(t: float) -> Float64Array:
        leg = min(int(np.searchsorted(begins, t, side="right")) - 1, len(times) - 1)
        part = min((t - begins[leg]) / max(times[leg], 1e-9), 1.0)
        return corners[leg] + (corners[leg + 1] - corners[leg]) * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)

    return Phase(duration_s=float(begins[-1]), hands=(MovingHand(node=node, offset_m=offset_m),))


def _wander(rng: np.random.Generator) -> Callable[[Float64Array], Float64Array]:
    """A smooth random path (…, 3) over time (…) [s], from 0 and from rest, of any size."""
    rates = 2.0 * np.pi * rng.uniform(0.3, 0.9, size=(2, 3))  # [rad/s]
    sizes = rng.normal(size=(2, 3)) / rates * np.array([1.0, 1.0, 0.5])
    phases = rng.uniform(-np.pi, np.pi, size=(2, 3))

    def path(t: Float64Array) -> Float64Array:
        waves = sizes * (np.sin(rates * t[..., None, None] + phases) - np.sin(phases))
        return _ease(t)[..., None] * waves.sum(axis=-2)

    return path


def _ease(t: Float64Array) -> Float64Array:
    """0 to 1 within half a second, without a jump of the acceleration at the start."""
    part = np.clip(t / 0.5, 0.0, 1.0)
    return part**3 * (10.0 - 15.0 * part + 6.0 * part**2)


def _fastest(track: Float64Array) -> float:
    """Top speed along a track (len(_SECONDS), 3)."""
    return float(np.linalg.norm(np.diff(track, axis=0), axis=1).max() / (_SECONDS[1] - _SECONDS[0]))


def _scaled(path: Callable[[Float64Array], Float64Array], factor: float) -> Callable[[float], Float64Array]:
    return lambda t: factor * path(np.asarray(t, dtype=np.float64))
