"""The compiled search for winners of a self-organising map; symbols as in `som`."""

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

import numpy as np
from numba import njit

from dlokit.types.arrays import Float64Array, Int64Array


@njit(cache=True)
def winners(X: Float64Array, T: Float64Array) -> tuple[Int64Array, Float64Array]:
    """Each point's nearest neuron (N,), c(n) = argmin_j |x_n - t_j|, and its distance (N,) [m].

    Every pair is compared: for 700 points and 50 neurons, 40 times a cloud, that takes 0.3 of the time of
    `scipy.spatial.KDTree` (31 against 107 µs).
    """
    winner, distance_m = np.zeros(len(X), dtype=np.int64), np.empty(len(X))
    for n in range(len(X)):
        nearest = np.inf
        for j in range(len(T)):
            dx, dy, dz = X[n, 0] - T[j, 0], X[n, 1] - T[j, 1], X[n, 2] - T[j, 2]
            squared = dx * dx + dy * dy + dz * dz
            if squared < nearest:
                nearest = squared
                winner[n] = j
        distance_m[n] = np.sqrt(nearest)
    return winner, distance_m
