"""From the mouse's path to a goal: points where the line of sight meets the table, as a curve of the DLO's length."""

import numpy as np
from scipy import ndimage

from dlokit import geometry
from dlokit.description.shapes import fit_length, length
from dlokit.types.arrays import Float64Array

CLICK_M = 0.05
"""A drawn line shorter than this is a click [m]."""
_SMOOTH_M = 0.03
"""Standard deviation of the filter over the arc that removes the jitter of a hand [m]; less than half of the tightest
bend that friction holds."""
_STEP_M = 0.002
_MANY = 200


def on_plane(eye_world: Float64Array, through_world: Float64Array, z_m: float) -> Float64Array | None:
    """Where the line from an eye (3,) [m] through a point (3,) [m] meets the plane of height z (2,) [m]; None: nowhere.

    The eye must be above the plane and look down.
    """
    drop = eye_world[2] - through_world[2]
    if drop <= 1e-9 or eye_world[2] <= z_m:
        return None
    share = (eye_world[2] - z_m) / drop
    return (eye_world + share * (through_world - eye_world))[:2]


def drawn_curve(points: Float64Array, length_m: float, radius_m: float, count: int) -> Float64Array | None:
    """The drawn points (K, 2) [m] on the table as a goal (count, 3) [m] of the DLO's length; None for a click.

    The line is smoothed; then it is cut where it is longer than the DLO, and continued straight where it is shorter, so
    that the DLO lies where it was drawn.
    """
    apart = np.concatenate(([True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6))
    line = points[apart]
    if len(line) < 2 or length(line) < CLICK_M:
        return None
    smooth = _smoothed(line)
    return on_rod(_of_length(smooth, length_m), length_m, radius_m, count)


def on_rod(points: Float64Array, length_m: float, radius_m: float, count: int) -> Float64Array:
    """A line (K, 2) [m] on the table, nearly as long as the DLO, as nodes (count, 3) [m] of exactly its length."""
    nodes = np.column_stack([geometry.resample(points, count), np.full(count, radius_m)])
    return fit_length(nodes, length_m)


def _smoothed(line: Float64Array) -> Float64Array:
    """The line (K, 2) [m] filtered along its arc by a Gaussian; both ends stay, and their directions are continued."""
    count = max(int(length(line) / _STEP_M), _MANY)
    fine = geometry.resample(line, count)
    step_m = length(line) / (count - 1)
    reach = min(int(3.0 * _SMOOTH_M / step_m), count - 1)
    # Reflected through each end, so that the filter neither shortens nor turns the ends.
    before, after = 2.0 * fine[0] - fine[reach:0:-1], 2.0 * fine[-1] - fine[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, fine, after])
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step_m / _SMOOTH_M) ** 2)
    weights /= weights.sum()
    filtered: Float64Array = ndimage.correlate1d(padded, weights, axis=0)
    return filtered[reach:-reach]


def _of_length(line: Float64Array, length_m: float) -> Float64Array:
    s = geometry.arc_lengths(line)
    if s[-1] >= length_m:
        kept = line[s < length_m]
        last = np.array([np.interp(length_m, s, line[:, axis]) for axis in range(2)])
        return np.concatenate([kept, last[None]])
    missing_m = length_m - s[-1]
    along = line[-1] - line[-2]
    back = line[0] - line[1]
    half = 0.5 * missing_m
    return np.concatenate(
        [
            (line[0] + half * back / np.linalg.norm(back))[None],
            line,
            (line[-1] + half * along / np.linalg.norm(along))[None],
        ]
    )
