"""The chain of nodes as a curve: arc lengths, and places along it."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_END_M = 0.02  # past an end the curve goes straight on, along its last stretch of this length


@njit(cache=True)
def arc_lengths(nodes: Array) -> Array:
    """Arc length of each node (M, 3) from node 0, (M,) [m]."""
    s = np.zeros(nodes.shape[0])
    for i in range(1, nodes.shape[0]):
        a, b, c = nodes[i, 0] - nodes[i - 1, 0], nodes[i, 1] - nodes[i - 1, 1], nodes[i, 2] - nodes[i - 1, 2]
        s[i] = s[i - 1] + np.sqrt(a * a + b * b + c * c)
    return s


@njit(cache=True)
def places(nodes: Array, s: Array, wanted_m: Array) -> Array:
    """Positions (n, 3) at arc lengths (n,) of the chain (M, 3), whose nodes lie at s (M,); straight on past an end."""
    found = np.empty((wanted_m.shape[0], 3))
    for axis in range(3):
        found[:, axis] = np.interp(wanted_m, s, nodes[:, axis])
    for end, sign in ((0, 1.0), (nodes.shape[0] - 1, -1.0)):
        inner = np.empty(3)
        for axis in range(3):
            inner[axis] = np.interp(s[end] + sign * _END_M, s, nodes[:, axis])
        away = nodes[end] - inner
        away /= max(np.sqrt(np.sum(away**2)), 1e-9)
        for n in range(wanted_m.shape[0]):
            past = sign * (s[end] - wanted_m[n])
            if past > 0.0:
                found[n] = nodes[end] + past * away
    return found
