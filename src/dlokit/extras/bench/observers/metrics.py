"""Node errors of an observer, and how well its health predicts them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from dlokit.extras.bench.observers.sequence import smooth_line
from dlokit.types.arrays import Float64Array

FLAGGED_WITHIN = 5
"""Number of frames within which a loss must show in the health."""


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Runs of consecutive lost frames in one sequence, and the number that the health detected."""

    count: int
    flagged: int


def rank_correlation(stated: Float64Array, errors: Float64Array) -> float | None:
    """Spearman's correlation of stated values (N,) and errors (N,), where both are finite; None without a spread."""
    known = np.isfinite(stated) & np.isfinite(errors)
    if np.count_nonzero(known) < 3:
        return None
    a, b = rankdata(stated[known]), rankdata(errors[known])
    if np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def losses(lost: NDArray[np.bool_], health: Float64Array, lost_health: float) -> Losses:
    """Count runs of lost frames (T,), and those whose health (T,) is below `lost_health` in time.

    A run that begins within `FLAGGED_WITHIN` frames of the end of the sequence does not count.
    """
    before = np.concatenate(([False], lost[:-1]))
    starts = np.flatnonzero(lost & ~before)
    starts = starts[starts + FLAGGED_WITHIN < len(lost)]
    low = [bool(np.any(health[start : start + FLAGGED_WITHIN + 1] < lost_health)) for start in starts]
    return Losses(count=len(low), flagged=sum(low))


LOST_M = 0.05
"""A frame with a larger mean error of the nodes counts as lost [m]."""
_LINE_POINTS = 64


CORRELATION = "health: rank correlation"
CORRELATION_FRAMES = "health: rank correlation, frames"
FLAGGED = "lost tracks flagged"
SETTLED = 1.5
"""A track has settled when its error is below this multiple of the median before the dark."""


@dataclass(frozen=True, kw_only=True)
class Track:
    """The estimates of one method for one sequence, with the ground truth. Frame 0, which was given, is omitted."""

    nodes_world: Float64Array  # (T, K, 3) [m]
    true_world: Float64Array  # (T, K, 3) [m]
    visible: NDArray[np.bool_]  # (T, K) whether a node was truly visible
    seconds: Float64Array  # (T,) processor time of each estimate [s]
    dark: NDArray[np.bool_]  # (T,) frames in which the case hides everything
    failed: NDArray[np.bool_]  # (T,) frames without an answer, for which the previous answer is used
    component_s: Float64Array | None = None  # (T,) the same for the whole observer component; None: a package
    health: Float64Array | None = None  # (T,) None: the method states no health
    cloud_m: Float64Array | None = None  # (T,) mean distance of the cloud's points to the estimate [m]; NaN: no points
    length_error: Float64Array | None = None  # (T,) the estimate's length by the rod's, less 1
    stated_m: Float64Array | None = None  # (T, K) stated standard deviations [m], NaN if not stated; None: never stated

    @property
    def errors_m(self) -> Float64Array:
        """Distance of node i to the true node i, (T, K) [m]."""
        return np.linalg.norm(self.nodes_world - self.true_world, axis=2)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Frames (T,) with a mean error of the nodes above `LOST_M`."""
        return self.errors_m.mean(axis=1) > LOST_M


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A metric with its display format."""

    name: str
    unit: str
    factor: float
    """Factor from the unit of the figure to the shown unit."""
    shown: str
    digits: int = 1
    rare: bool = False
    """Shown only where it is not 0."""


METRICS: tuple[Metric, ...] = (
    Metric(name="node error", unit="m", factor=1e3, shown="mm"),
    Metric(name="node error, visible", unit="m", factor=1e3, shown="mm"),
    Metric(name="node error, hidden", unit="m", factor=1e3, shown="mm"),
    Metric(name="curve error", unit="m", factor=1e3, shown="mm"),
    Metric(name="tip error", unit="m", factor=1e3, shown="mm"),
    Metric(name="cloud error", unit="m", factor=1e3, shown="mm"),
    Metric(name="length error", unit="", factor=1e2, shown="%"),
    Metric(name="frames over 50 mm", unit="", factor=1e2, shown="%"),
    Metric(name="longest loss", unit="frames", factor=1.0, shown="frames"),
    Metric(name="frames to recover", unit="frames", factor=1.0, shown="frames"),
    Metric(name="frames to settle", unit="frames", factor=1.0, shown="frames"),
    Metric(name=CORRELATION, unit="", factor=1.0, shown="", digits=2),
    Metric(name=CORRELATION_FRAMES, unit="", factor=1.0, shown="", digits=2),
    Metric(name=FLAGGED, unit="", factor=1e2, shown="%"),
    Metric(name="frames without an answer", unit="", factor=1e2, shown="%", rare=True),
    Metric(name="time p50", unit="s", factor=1e3, shown="ms", digits=2),
    Metric(name="time p99", unit="s", factor=1e3, shown="ms", digits=2),
    Metric(name="component p50", unit="s", factor=1e3, shown="ms", digits=2),
    Metric(name="component p99", unit="s", factor=1e3, shown="ms", digits=2),
)


def score(track: Track) -> Mapping[str, float]:
    """Every applicable metric of one sequence, in SI units.

    Node errors are mean distances of node i to the true node i, in the order of the DLO. Where the true nodes are not
    known, the distance of the cloud to the estimate and the estimate's length are compared.
    """
    if not np.isfinite(track.true_world).all():
        return _score_of_clouds(track)
    errors = track.errors_m  # (T, K)
    per_frame = errors.mean(axis=1)
    figures = {"node error": float(per_frame.mean())}
    if track.visible.any():
        figures["node error, visible"] = float(errors[track.visible].mean())
    if not track.visible.all():
        figures["node error, hidden"] = float(errors[~track.visible].mean())
    pairs = zip(track.nodes_world, track.true_world, strict=True)
    figures["curve error"] = float(np.mean([curve_error_m(nodes, true) for nodes, true in pairs]))
    figures["tip error"] = float(errors[:, [0, -1]].mean())
    figures["frames over 50 mm"] = float(track.lost.mean())
    figures["longest loss"] = float(longest_loss(track.lost, np.asarray(track.visible.any(axis=1))))
    return figures | _answers(track) | _recovery(per_frame, track.dark) | _trust(track)


def _score_of_clouds(track: Track) -> Mapping[str, float]:
    assert track.cloud_m is not None
    assert track.length_error is not None
    figures = {"length error": float(np.abs(track.length_error).mean())}
    if np.isfinite(track.cloud_m).any():
        figures["cloud error"] = float(np.nanmean(track.cloud_m))
    return figures | _answers(track)


def _answers(track: Track) -> dict[str, float]:
    """How often there was no answer, and the times of the others."""
    figures = {
        "frames without an answer": float(track.failed.mean()),
        "time p50": float(np.percentile(track.seconds, 50)),
        "time p99": float(np.percentile(track.seconds, 99)),
    }
    if track.component_s is not None:
        figures["component p50"] = float(np.percentile(track.component_s, 50))
        figures["component p99"] = float(np.percentile(track.component_s, 99))
    return figures


def _recovery(error_m: Float64Array, dark: NDArray[np.bool_]) -> dict[str, float]:
    """Frames after the dark until the track is found, and until it is as good as before; for a case with a dark."""
    if not dark.any():
        return {}
    first, last = np.flatnonzero(dark)[[0, -1]]
    after = error_m[last + 1 :]
    figures = {"frames to recover": float(_until(after < LOST_M))}
    if first > 0:
        as_before = SETTLED * float(np.median(error_m[:first]))
        figures["frames to settle"] = float(_until(after < min(LOST_M, as_before)))
    return figures


def _until(reached: NDArray[np.bool_]) -> int:
    """Number of frames (T,) before the first True; all frames if there is no True."""
    return int(np.argmax(reached)) if reached.any() else len(reached)


def _trust(track: Track) -> dict[str, float]:
    """Rank correlations of stated uncertainty with error, over nodes, and over the means of frames."""
    if track.stated_m is None:
        return {}
    errors = track.errors_m
    known = np.isfinite(track.stated_m).all(axis=1)
    nodes = rank_correlation(track.stated_m.ravel(), errors.ravel())
    frames = rank_correlation(track.stated_m[known].mean(axis=1), errors[known].mean(axis=1))
    return {name: value for name, value in ((CORRELATION, nodes), (CORRELATION_FRAMES, frames)) if value is not None}


def curve_error_m(nodes: Float64Array, true: Float64Array) -> float:
    """Two-way curve error [m]: mean distance of the nodes of each (K, 3) [m] to the other's curve.

    A few nodes are far apart: the curve between them is smooth, not the chords.
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


def longest_loss(lost: NDArray[np.bool_], shown: NDArray[np.bool_]) -> int:
    """The longest run of lost frames (T,); dark frames (T,) neither count nor end a run.

    A track that is never found again counts to the end of the sequence. 0: never lost outside the dark.
    """
    longest = row = 0
    for is_lost in lost[shown]:
        row = row + 1 if is_lost else 0
        longest = max(longest, row)
    return longest
