"""What touches the planning rod beside the table: tools whose fingers hold it, and closed fingers that push it.

Closed fingers are a moving wall with round ends on the table. If a point of the rod is nearer to the middle line of the
wall than the sum of both radii, a stiff one-sided spring pushes it out. The spring is implicit in the rod's step and
so stable. The rod slides freely along the wall: this fits the effect of closed fingers on the simulated cell's rod
better than any friction does.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dlokit.types.arrays import Float64Array


class Contacts(NamedTuple):
    """What touches the rod during a motion; without arguments, nothing does."""

    tool: Float64Array = np.zeros((0, 4))
    """(T, 4 K): x, y, z [m] and yaw [rad] of K tools at every step."""
    pads: Float64Array = np.zeros((0, 4))
    """(n, 4): for each point of the rod between pads, its position in nodes from the first, its offset from its tool
    (along, up) [m], and the number of that tool."""
    fingers: Float64Array = np.zeros(3)
    """(3,): from `rollout.closed_fingers` if the fingers of the first tool push; zeros if they hold."""


_PUSH_N_M = 800.0  # stiffness of the spring at one point of the rod
_POINTS = 4  # points per edge that are tested for contact


@njit(cache=True, nogil=True, error_model="numpy")
def add_fingers(
    x: Float64Array,
    tool: Float64Array,
    fingers: Float64Array,
    radius: float,
    h: float,
    band: Float64Array,
    right: Float64Array,
) -> None:
    """Add the fingers at `tool` (4,): x, y, z [m], yaw [rad] to one implicit step of length `h` [s].

    `x` (M, 5): the rod as in `advance`; `fingers` (3,) from `rollout.closed_fingers`; `band` and `right`: the matrix
    and the right-hand side of the rod's step.
    """
    reach = fingers[1] + radius
    edge = math.sqrt((x[1, 0] - x[0, 0]) ** 2 + (x[1, 1] - x[0, 1]) ** 2 + (x[1, 2] - x[0, 2]) ** 2)
    far = fingers[0] + reach + 2.0 * edge
    # The middle line is along the tool's y axis, which is on its right-hand side, because the tool points down.
    ax, ay = math.sin(tool[3]), -math.cos(tool[3])
    for i in range(len(x) - 1):
        if (x[i, 0] - tool[0]) ** 2 + (x[i, 1] - tool[1]) ** 2 > far * far:
            continue
        for k in range(_POINTS):
            fraction = (k + 0.5) / _POINTS
            px = (1.0 - fraction) * x[i, 0] + fraction * x[i + 1, 0] - tool[0]
            py = (1.0 - fraction) * x[i, 1] + fraction * x[i + 1, 1] - tool[1]
            pz = (1.0 - fraction) * x[i, 2] + fraction * x[i + 1, 2]
            along = min(max(px * ax + py * ay, -fingers[0]), fingers[0])
            mx, my = px - along * ax, py - along * ay
            distance = math.sqrt(mx * mx + my * my)
            # The fingers do not touch a rod below the tips; exactly on the middle line the direction is undefined.
            if distance < reach and distance > 1e-6 and pz + 0.5 * radius > tool[2] - fingers[2]:
                _add(i, fraction, mx / distance, my / distance, reach - distance, h, band, right)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    i: int, fraction: float, mx: float, my: float, depth: float, h: float, band: Float64Array, right: Float64Array
) -> None:
    """Add the spring at one point between two nodes, along (mx, my), to both of them."""
    row, first, stiff, force = 4 * i, 1.0 - fraction, h * h * _PUSH_N_M, h * _PUSH_N_M * depth
    right[row] += first * force * mx
    right[row + 1] += first * force * my
    right[row + 4] += fraction * force * mx
    right[row + 5] += fraction * force * my
    for node, weight in ((row, first * first), (row + 4, fraction * fraction)):
        band[node, 0] += weight * stiff * mx * mx
        band[node + 1, 0] += weight * stiff * my * my
        band[node, 1] += weight * stiff * mx * my
    mixed = first * fraction * stiff
    band[row, 4] += mixed * mx * mx
    band[row + 1, 4] += mixed * my * my
    band[row, 5] += mixed * mx * my
    band[row + 1, 3] += mixed * mx * my
