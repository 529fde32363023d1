"""How far an observer's nodes are from the true ones."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.bench.observers.centre_line import smooth_line
from dlokit.types.arrays import Float64Array

LOST_M = 0.05
"""A frame whose nodes are further off than this, in the mean, counts as lost [m]."""
_LINE_POINTS = 64


@dataclass(frozen=True, kw_only=True)
class Track:
    """What one method made of one sequence, beside the truth. Frame 0, which was given, is left out."""

    nodes_world: Float64Array  # (T, K, 3) [m]
    true_world: Float64Array  # (T, K, 3) [m]
    visible: NDArray[np.bool_]  # (T, K) whether a node could be seen, in truth
    seconds: Float64Array  # (T,) processor time of each estimate [s]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A figure, with how people want to read it."""

    name: str
    unit: str
    factor: float
    """From the unit of the figure to the one shown."""
    shown: str


METRICS: tuple[Metric, ...] = (
    Metric(name="node error", unit="m", factor=1e3, shown="mm"),
    Metric(name="node error, visible", unit="m", factor=1e3, shown="mm"),
    Metric(name="node error, hidden", unit="m", factor=1e3, shown="mm"),
    Metric(name="curve error", unit="m", factor=1e3, shown="mm"),
    Metric(name="tip error", unit="m", factor=1e3, shown="mm"),
    Metric(name="frames over 50 mm", unit="", factor=1e2, shown="%"),
    Metric(name="frames to recover", unit="frames", factor=1.0, shown="frames"),
    Metric(name="time p50", unit="s", factor=1e3, shown="ms"),
    Metric(name="time p99", unit="s", factor=1e3, shown="ms"),
)


def score(track: Track) -> Mapping[str, float]:
    """Every metric of one sequence, in SI units; one that does not apply is left out.

    Node errors are mean distances of node i to the true node i, in the order of the DLO.
    """
    errors = np.linalg.norm(track.nodes_world - track.true_world, axis=2)  # (T, K)
    per_frame = errors.mean(axis=1)
    figures = {"node error": float(per_frame.mean())}
    if track.visible.any():
        figures["node error, visible"] = float(errors[track.visible].mean())
    if not track.visible.all():
        figures["node error, hidden"] = float(errors[~track.visible].mean())
    pairs = zip(track.nodes_world, track.true_world, strict=True)
    figures["curve error"] = float(np.mean([curve_error_m(nodes, true) for nodes, true in pairs]))
    figures["tip error"] = float(errors[:, [0, -1]].mean())
    lost = per_frame > LOST_M
    figures["frames over 50 mm"] = float(lost.mean())
    figures["frames to recover"] = float(frames_to_recover(lost, np.asarray(track.visible.any(axis=1))))
    figures["time p50"] = float(np.percentile(track.seconds, 50))
    figures["time p99"] = float(np.percentile(track.seconds, 99))
    return figures


def curve_error_m(nodes: Float64Array, true: Float64Array) -> float:
    """Two-way curve error [m]: mean distance of the nodes of each (K, 3) [m] to the other's curve.

    Few nodes are far apart: the curve between them is the smooth one, not its chords.
    """
    there = to_polyline_m(nodes, smooth_line(true, _LINE_POINTS))
    back = to_polyline_m(true, smooth_line(nodes, _LINE_POINTS))
    return float((there.mean() + back.mean()) / 2.0)


def to_polyline_m(points: Float64Array, line: Float64Array) -> Float64Array:
    """Distance (N,) [m] of points (N, 3) [m] to the polyline through (K, 3) [m]."""
    start, edges = line[:-1], np.diff(line, axis=0)
    away = points[:, None, :] - start
    along = np.sum(away * edges, axis=2) / np.maximum(np.sum(edges**2, axis=1), 1e-18)
    rest = away - np.clip(along, 0.0, 1.0)[:, :, None] * edges
    return np.linalg.norm(rest, axis=2).min(axis=1)


def frames_to_recover(lost: NDArray[np.bool_], shown: NDArray[np.bool_]) -> int:
    """The longest row of lost frames (T,); frames in which nothing was shown (T,) do not count, nor end a row.

    A track that is lost for good counts to the end of the sequence. 0: never lost while anything was shown.
    """
    longest = row = 0
    for is_lost in lost[shown]:
        row = row + 1 if is_lost else 0
        longest = max(longest, row)
    return longest
