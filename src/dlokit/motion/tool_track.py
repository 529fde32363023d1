"""Position of a tool at every step of a rollout: the robot's rounded path and its time law, without the joints.

The same path and time law as in `dlokit.motion.tool_path` and `trajectories`, without the limits of the joints.
"""

import math

import numpy as np
from numba import njit

from dlokit.motion.tool_path import ROUNDING_M, SHARPEST_COSINE, SHORTEST_M, TURN_LEVER_M
from dlokit.types.arrays import Float64Array

_GRID_M = 0.01  # largest distance of two points of a path


@njit(cache=True, nogil=True, error_model="numpy")
def tool_track(
    waypoints: Float64Array, speed_m_s: float, acceleration_m_s2: float, jerk_m_s3: float, step_s: float
) -> Float64Array:
    """The tool (T, 4) at every `step_s` [s] of a motion through `waypoints` (W, 4): x, y, z [m], yaw [rad].

    It starts and ends at rest, rounds corners, and stops where the path turns back.
    """
    track = np.empty((0, 4))
    first = 0
    for last in range(1, len(waypoints)):
        if last < len(waypoints) - 1 and not _sharp(waypoints, last):
            continue
        piece = _piece(waypoints[first : last + 1], speed_m_s, acceleration_m_s2, jerk_m_s3, step_s)
        track = np.concatenate((track, piece))
        first = last
    return track


@njit(cache=True, nogil=True, error_model="numpy")
def rounded_path(waypoints: Float64Array) -> Float64Array:
    """The tool (K, 4) along the same path, at most a centimetre apart: where a corner is rounded, it passes beside."""
    path = waypoints[:1]
    first = 0
    for last in range(1, len(waypoints)):
        if last < len(waypoints) - 1 and not _sharp(waypoints, last):
            continue
        path = np.concatenate((path, _grid(waypoints[first : last + 1])[1][1:]))
        first = last
    return path


@njit(cache=True, nogil=True, error_model="numpy")
def _sharp(waypoints: Float64Array, corner: int) -> bool:
    before, after = waypoints[corner, :3] - waypoints[corner - 1, :3], waypoints[corner + 1, :3] - waypoints[corner, :3]
    norm = math.sqrt(np.sum(before**2) * np.sum(after**2))
    return bool(norm > 0.0 and np.sum(before * after) / norm < SHARPEST_COSINE)


@njit(cache=True, nogil=True, error_model="numpy")
def _piece(waypoints: Float64Array, speed: float, acceleration: float, jerk: float, step_s: float) -> Float64Array:
    """The tool (T, 4) from rest to rest along one rounded path."""
    ends, grid = _grid(waypoints)
    count = len(grid) - 1
    pace = _pace(grid, ends[-1] / count, speed, acceleration)
    travelled = _travelled(pace, ends[-1] / count, acceleration / jerk, step_s)
    track = np.empty((len(travelled), 4))
    for axis in range(4):
        track[:, axis] = np.interp(travelled, np.linspace(0.0, ends[-1], count + 1), grid[:, axis])
    return track


@njit(cache=True, nogil=True, error_model="numpy")
def _grid(waypoints: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Path parameters (W,) [m] at the waypoints, and the tool (K, 4) at equal distances along one rounded path."""
    ends = np.zeros(len(waypoints))
    for k in range(1, len(waypoints)):
        leg = waypoints[k] - waypoints[k - 1]
        straight = math.sqrt(leg[0] ** 2 + leg[1] ** 2 + leg[2] ** 2)
        ends[k] = ends[k - 1] + max(straight, TURN_LEVER_M * abs(leg[3]), SHORTEST_M)
    count = max(8, math.ceil(ends[-1] / _GRID_M))
    grid = np.empty((count + 1, 4))
    for k in range(count + 1):
        grid[k] = _place(waypoints, ends, ends[-1] * k / count)
    return ends, grid


@njit(cache=True, nogil=True, error_model="numpy")
def _travelled(pace: Float64Array, grid_m: float, smoothing_s: float, step_s: float) -> Float64Array:
    """The path parameter (T,) [m] after every step: the pace, smoothed over time so that the jerk is bounded."""
    times = np.zeros(len(pace))
    for k in range(1, len(pace)):
        times[k] = times[k - 1] + 2.0 * grid_m / max(pace[k] + pace[k - 1], 1e-6)
    steps, window = max(2, math.ceil(times[-1] / step_s)), max(1, math.ceil(smoothing_s / step_s))
    rate = np.zeros(steps + window)
    rate[:steps] = np.interp((np.arange(steps) + 0.5) * (times[-1] / steps), times, pace)
    travelled, moving = np.empty(len(rate)), 0.0
    for k in range(len(rate)):
        moving += rate[k] - (rate[k - window] if k >= window else 0.0)
        travelled[k] = moving + (travelled[k - 1] if k > 0 else 0.0)
    return travelled * ((len(pace) - 1) * grid_m / travelled[-1])


@njit(cache=True, nogil=True, error_model="numpy")
def _place(waypoints: Float64Array, ends: Float64Array, at: float) -> Float64Array:
    """The tool (4,) at a path parameter; corners are quadratic Bézier curves."""
    leg = 1
    while leg < len(ends) - 1 and ends[leg] < at:
        leg += 1
    for corner in (leg - 1, leg):
        if 0 < corner < len(ends) - 1:
            before, after = ends[corner] - ends[corner - 1], ends[corner + 1] - ends[corner]
            reach = min(ROUNDING_M, 0.5 * before, 0.5 * after)
            after_start = at - (ends[corner] - reach)
            if 0.0 < after_start < 2.0 * reach:
                u = after_start / (2.0 * reach)
                start = waypoints[corner] + reach / before * (1.0 - u) * (waypoints[corner - 1] - waypoints[corner])
                end = waypoints[corner] + reach / after * u * (waypoints[corner + 1] - waypoints[corner])
                return (1.0 - u) * start + u * end
    fraction = (at - ends[leg - 1]) / (ends[leg] - ends[leg - 1])
    return waypoints[leg - 1] + min(max(fraction, 0.0), 1.0) * (waypoints[leg] - waypoints[leg - 1])


@njit(cache=True, nogil=True, error_model="numpy")
def _pace(grid: Float64Array, step_m: float, speed: float, acceleration: float) -> Float64Array:
    """Speed along the path at each point of the grid [m/s]: slow in bends and at both ends."""
    count = len(grid)
    square = np.full(count, speed**2)
    for k in range(1, count - 1):
        bend = 0.0
        for axis in range(3):
            bend += (grid[k + 1, axis] - 2.0 * grid[k, axis] + grid[k - 1, axis]) ** 2
        square[k] = min(square[k], acceleration * step_m**2 / max(math.sqrt(bend), 1e-9))
    square[0] = square[count - 1] = 0.0
    for k in range(1, count):
        square[k] = min(square[k], square[k - 1] + 2.0 * acceleration * step_m)
    for k in range(count - 2, -1, -1):
        square[k] = min(square[k], square[k + 1] + 2.0 * acceleration * step_m)
    return np.sqrt(square)
