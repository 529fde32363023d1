"""The shortest move on the table that brings a shape to where the arm reaches, the camera sees, and the table is."""

import math
from collections.abc import Callable

import numpy as np

from dlokit.types.arrays import Float64Array

_STEP_M = 0.01  # distance of two rings of moves
_RINGS = 40
_DIRECTIONS = 16
_HALVINGS = 4  # of the last step, so that the move is right to less than a millimetre


def moved_inside(nodes_world: Float64Array, inside: Callable[[Float64Array], bool]) -> Float64Array | None:
    """A shape (M, 3) [m] moved by as little as need be to be `inside`; None where no move up to 0.4 m does it.

    Moves are tried in rings of 16 directions.
    """
    if inside(nodes_world):
        return nodes_world
    for ring in range(1, _RINGS + 1):
        for turn in range(_DIRECTIONS):
            angle = 2.0 * math.pi * turn / _DIRECTIONS
            direction = np.array([math.cos(angle), math.sin(angle), 0.0])
            if inside(nodes_world + ring * _STEP_M * direction):
                return _shortened(nodes_world, direction, ring * _STEP_M, inside)
    return None


def _shortened(
    nodes_world: Float64Array, direction: Float64Array, far_m: float, inside: Callable[[Float64Array], bool]
) -> Float64Array:
    near_m = far_m - _STEP_M
    for _ in range(_HALVINGS):
        middle_m = (near_m + far_m) / 2.0
        if inside(nodes_world + middle_m * direction):
            far_m = middle_m
        else:
            near_m = middle_m
    return nodes_world + far_m * direction
