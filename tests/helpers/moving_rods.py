"""Sequences of a moving inextensible rod, and of the clouds that a camera would see of it.

The tangent of the rod has a heading theta(s, t), a sum of slow waves along the rod, and a slope that lifts it
off the table in a hump; its nodes are the integral of the tangent, so that the rod is inextensible. Time is scaled such
that the fastest node moves at the requested speed.
"""

from dataclasses import dataclass

import numpy as np

from dlokit.skills.observer.anchored import chain
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import Topology
from dlokit.types.observation import Observation

LENGTH_M = 0.5
FINE = 501


@dataclass(frozen=True, kw_only=True)
class Case:
    """Parameters of a sequence."""

    speed_m_s: float = 0.5
    rate_hz: float = 30.0
    frames: int = 45
    hidden: tuple[float, float] | None = (0.35, 0.65)
    """The hidden part, as fractions of the length."""
    noise_m: float = 0.002
    outliers: float = 0.05
    points: int = 1500
    lift: float = 0.3


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """A moving rod with the clouds seen of it."""

    truth: Float64Array
    """(T, M, 3) [m]."""
    clouds: tuple[Observation, ...]
    topology: Topology


def moving_rod(case: Case, seed: int, nodes: int = 50) -> Sequence:
    """One sequence; its first truth is meant as the first prior, and the clouds start with the second."""
    rng = np.random.default_rng(seed)
    curves = _curves(case, rng)
    places = np.linspace(0, FINE - 1, nodes)
    truth = np.stack([_at(curve, places) for curve in curves])
    clouds = tuple(_cloud(curve, case, rng, frame) for frame, curve in enumerate(curves[1:], start=1))
    return Sequence(truth=truth, clouds=clouds, topology=chain(nodes, LENGTH_M))


def _curves(case: Case, rng: np.random.Generator) -> list[Float64Array]:
    """The rod as FINE points in each frame."""
    u = np.linspace(0.0, 1.0, FINE)
    size = rng.normal(0.0, [1.2, 0.9, 0.5])
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 3)), rng.uniform(0.5, 1.5, (3, 3))
    start, sway = rng.uniform(0, 2 * np.pi), rng.uniform(-0.15, 0.15, (2, 2))

    def curve(tau: float) -> Float64Array:
        heading = start + 0.6 * np.sin(rate[2, 0] * tau)
        for k in range(3):
            wave = np.sin(np.pi * (k + 1) * u + phase[0, k] + 0.5 * rate[0, k] * tau)
            heading = heading + size[k] * (1.0 + 0.4 * np.sin(rate[1, k] * tau + phase[1, k])) * wave
        rise = case.lift * 0.5 * (1 - np.cos(rate[2, 1] * tau)) * np.sin(2 * np.pi * u)
        run = np.sqrt(1 - rise**2)
        tangent = np.column_stack([run * np.cos(heading), run * np.sin(heading), rise])
        middle = 0.5 * (tangent[1:] + tangent[:-1]) * LENGTH_M / (FINE - 1)
        xyz = np.vstack([np.zeros(3), np.cumsum(middle, axis=0)])
        xyz[:, :2] += [0.5, 0.0] - xyz[0, :2] + sway[0] * np.sin(tau) + sway[1] * np.cos(tau)
        xyz[:, 2] += 0.004 - min(xyz[:, 2].min(), 0.0)
        return xyz

    tau, frames = rng.uniform(0, 6), [curve(0.0)]
    frames[0] = curve(tau)
    for _ in range(case.frames):
        speed = np.max(np.linalg.norm(curve(tau + 1e-4) - frames[-1], axis=1)) / 1e-4
        tau += case.speed_m_s / case.rate_hz / speed
        frames.append(curve(tau))
    return frames


def _at(curve: Float64Array, places: Float64Array) -> Float64Array:
    return np.column_stack([np.interp(places, np.arange(FINE), curve[:, axis]) for axis in range(3)])


def _cloud(curve: Float64Array, case: Case, rng: np.random.Generator, frame: int) -> Observation:
    at = rng.uniform(0.0, 1.0, case.points)
    if case.hidden is not None:
        at = at[(at < case.hidden[0]) | (at > case.hidden[1])]
    seen = _at(curve, at * (FINE - 1)) + rng.normal(0.0, case.noise_m, (len(at), 3))
    low, high = curve.min(axis=0) - 0.05, curve.max(axis=0) + np.array([0.05, 0.05, 0.03])
    stray = rng.uniform(low, high, (int(case.outliers * len(at)), 3))
    points = rng.permutation(np.vstack([seen, stray])).astype(np.float32)
    return Observation(stamp_ns=int(frame * 1e9 / case.rate_hz), points_world=points)
