"""A stand-in for a motion-captured cable: stiff, 1 m long, few markers, both ends moved through the air."""

from pathlib import Path
from typing import Any

import numpy as np

from dlokit.geometry import matrix, pose

NODES = 13
LENGTH_M = 1.0


def cable_nodes(frames: int, rate_hz: float) -> np.ndarray:
    """Equally spaced nodes (T, NODES, 3) [m] of the cable: it bends periodically and drifts as a whole."""
    t = np.arange(frames)[:, None] / rate_hz
    s = np.linspace(0.0, LENGTH_M, 1201)
    bend = (2.5 + np.sin(1.3 * t)) * np.sin(np.pi * s) + np.sin(0.7 * t) * np.sin(2.0 * np.pi * s)  # [1/m]
    angle = np.cumsum(bend, axis=1) * (s[1] - s[0])
    angle -= angle.mean(axis=1, keepdims=True)
    steps = np.stack([np.cos(angle), 0.3 * np.sin(angle), np.sqrt(0.91) * np.sin(angle)], axis=2) * (s[1] - s[0])
    curve = np.cumsum(steps, axis=1)
    drift = 0.1 * np.stack([np.sin(0.9 * t), np.cos(0.6 * t), np.sin(0.5 * t)], axis=2)
    curve += np.array([0.0, 0.0, 0.5]) + drift - curve.mean(axis=1, keepdims=True)
    return curve[:, :: 1200 // (NODES - 1)]


def cable_arrays(frames: int, rate_hz: float = 60.0) -> dict[str, Any]:
    """The arrays of a sequence file: nodes, the ends as pins, and a camera that looks along y, 1.5 m away."""
    nodes = cable_nodes(frames, rate_hz)
    camera = pose([0.0, -1.5, 0.5], [np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])
    return {"nodes": nodes, "rate_hz": rate_hz, "pins": nodes[:, [0, -1]], "T_world_camera": matrix(camera)}


def write_cable(path: Path, frames: int, rate_hz: float = 60.0) -> Path:
    """A sequence file."""
    np.savez(path, **cable_arrays(frames, rate_hz))
    return path
