"""Hidden nodes: they follow their visible neighbours, in the shape they had before."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def fill_hidden(nodes: Array, known: Flags, prior: Array) -> Array:
    """The nodes (M, 3) [m], those not `known` (M,) moved as their known neighbours moved from the `prior`.

    Between known nodes the displacement from the prior is interpolated without overshoot; past the last
    known node the prior's end is carried along rigidly with the last few known ones. With no known node the
    prior is returned.
    """
    index = np.flatnonzero(known)
    if len(index) == len(nodes):
        return nodes
    if len(index) == 0:
        return prior.copy()
    result = nodes.copy()
    first, last = index[0], index[-1]
    inner = np.arange(first, last + 1)[~known[first : last + 1]]
    if len(inner) > 0:
        moved = PchipInterpolator(index, nodes[index] - prior[index])
        result[inner] = prior[inner] + moved(inner)
    if first > 0:
        result[:first] = _carried(prior[:first], prior[index[:4]], nodes[index[:4]])
    if last < len(nodes) - 1:
        result[last + 1 :] = _carried(prior[last + 1 :], prior[index[-4:]], nodes[index[-4:]])
    return result


def _carried(part: Array, before: Array, after: Array) -> Array:
    """`part` (n, 3) moved by the turn about z and the shift that best bring `before` to `after`.

    Only about z: a rod on a table cannot roll, and few nodes in a row do not fix the other turns.
    """
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2]))
    cosine, sine = np.cos(angle), np.sin(angle)
    R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return (part - before.mean(axis=0)) @ R.T + after.mean(axis=0)
