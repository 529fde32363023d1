"""The local structure of a shape: how each node is put together from its neighbours.

Roweis, Saul: *Nonlinear Dimensionality Reduction by Locally Linear Embedding*, Science 290 (2000),
doi 10.1126/science.290.5500.2323. Symbols: Y (M, D) the nodes of the reference shape, K the number of
neighbours, W (M, M) the weights, row i those of node i.
"""

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Array = NDArray[np.float64]


def lle_weights(Y: Array, neighbours: int, regularisation: float) -> Array:
    """W (M, M) that minimises sum_i |y_i - sum_j w_ij y_j|² with sum_j w_ij = 1, w_ij = 0 off the neighbours.

    With z_j = y_j - y_i of node i's K nearest nodes and the local Gram matrix C_jk = z_j · z_k, the weights
    are those of C w = 1, scaled to the sum 1. More neighbours than dimensions, or neighbours on a line, make
    C singular: `regularisation` times the trace of C is added to its diagonal, so that the weights do not
    depend on the scale of the shape. Fewer nodes than K + 1: all others are neighbours.
    """
    M = len(Y)
    K = min(neighbours, M - 1)
    W = np.zeros((M, M))
    for i, near in enumerate(_nearest(Y, K)):
        Z = Y[near] - Y[i]
        C = Z @ Z.T
        trace = float(np.trace(C))
        C[np.diag_indices(K)] += regularisation * trace if trace > 0.0 else 1.0  # nodes in one place: equal weights
        w = np.linalg.solve(C, np.ones(K))
        W[i, near] = w / w.sum()
    return W


def structure_matrix(W: Array) -> Array:
    """(I - W)ᵀ (I - W) (M, M): tr Tᵀ M T is the squared error of putting T's nodes together by W."""
    rest = np.eye(len(W)) - W
    return rest.T @ rest


def _nearest(Y: Array, count: int) -> NDArray[np.int64]:
    """The `count` nearest other nodes of each node, (M, count)."""
    _, index = KDTree(Y).query(Y, k=count + 1)
    others = np.asarray(index, dtype=np.int64)
    itself = others == np.arange(len(Y))[:, None]
    itself[~itself.any(axis=1), -1] = True  # of nodes in one place, the node itself may not be listed
    return others[~itself].reshape(len(Y), count)
