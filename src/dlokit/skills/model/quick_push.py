"""Closed fingers that push the rod of planning: a wall with round ends that stands on the table and moves.

Where a point of the rod is nearer to the middle line of the wall than both radii together, a stiff one-sided spring
pushes it out, implicit in the step of `dlokit.skills.model.quick_rod` and so stable. Along the wall the rod slides
freely: that fits what closed fingers do to the rod of the simulated cell, where friction of any size fits worse.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINGERS = np.array([0.0085, 0.009, 0.0089])
"""The Panda's fingers, closed: half the length of the middle line across the tool, radius around it, and how far the
tips are below the tool [m]."""
NO_FINGERS = np.zeros(3)
"""For a motion that holds the rod."""
_PUSH_N_M = 800.0  # of the spring at one point of the rod
_POINTS = 4  # of an edge at which the rod is looked at


@njit(cache=True, nogil=True, error_model="numpy")
def push(x: Array, tool: Array, fingers: Array, radius: float, h: float, band: Array, right: Array) -> None:
    """Add the fingers at `tool` (4,): x, y, z [m], yaw [rad] to one implicit step of length `h` [s].

    `x` (M, 4): nodes with their roll; `fingers` (3,) as `FINGERS`; `band` and `right` as the rod has them.
    """
    reach = fingers[1] + radius
    edge = math.sqrt((x[1, 0] - x[0, 0]) ** 2 + (x[1, 1] - x[0, 1]) ** 2 + (x[1, 2] - x[0, 2]) ** 2)
    far = fingers[0] + reach + 2.0 * edge
    # The middle line lies across the tool, along its y axis; the tool points down, so that is its right-hand side.
    ax, ay = math.sin(tool[3]), -math.cos(tool[3])
    for i in range(len(x) - 1):
        if (x[i, 0] - tool[0]) ** 2 + (x[i, 1] - tool[1]) ** 2 > far * far:
            continue
        for k in range(_POINTS):
            share = (k + 0.5) / _POINTS
            px = (1.0 - share) * x[i, 0] + share * x[i + 1, 0] - tool[0]
            py = (1.0 - share) * x[i, 1] + share * x[i + 1, 1] - tool[1]
            pz = (1.0 - share) * x[i, 2] + share * x[i + 1, 2]
            along = min(max(px * ax + py * ay, -fingers[0]), fingers[0])
            mx, my = px - along * ax, py - along * ay
            distance = math.sqrt(mx * mx + my * my)
            # A rod below the tips is not touched, and one exactly in the middle has no side to go to.
            if distance < reach and distance > 1e-6 and pz + 0.5 * radius > tool[2] - fingers[2]:
                _add(i, share, mx / distance, my / distance, reach - distance, h, band, right)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(i: int, share: float, mx: float, my: float, depth: float, h: float, band: Array, right: Array) -> None:
    """Add the spring at one point between two nodes, along (mx, my), to both of them."""
    row, first, stiff, force = 4 * i, 1.0 - share, h * h * _PUSH_N_M, h * _PUSH_N_M * depth
    right[row] += first * force * mx
    right[row + 1] += first * force * my
    right[row + 4] += share * force * mx
    right[row + 5] += share * force * my
    for node, weight in ((row, first * first), (row + 4, share * share)):
        band[node, 0] += weight * stiff * mx * mx
        band[node + 1, 0] += weight * stiff * my * my
        band[node, 1] += weight * stiff * mx * my
    mixed = first * share * stiff
    band[row, 4] += mixed * mx * mx
    band[row + 1, 4] += mixed * my * my
    band[row, 5] += mixed * mx * my
    band[row + 1, 3] += mixed * mx * my
