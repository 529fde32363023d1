"""A DLO that is not seen: where it was, with an uncertainty that grows while it may move."""

import numpy as np
from numpy.typing import NDArray

from dlokit.types.dlo import DloState, TargetPoints

Array = NDArray[np.float64]

SURE_M = 0.005  # of nodes whose observer states no covariance: what the contract test asks of all of them
WIDEST_M = 0.5  # a node is somewhere on the table


def grown_covariance(prior: DloState, seconds: float, speed_m_s: float) -> Array:
    """Covariance (M, 3, 3) [m²] of the prior's nodes, not seen for so many seconds more.

    A node's standard deviation grows by `speed_m_s` a second, alike in all directions: in steps or at once, the same.
    """
    count = len(prior.nodes_world)
    before = prior.covariance
    if before is None or before.shape != (count, 3, 3):
        before = np.broadcast_to(np.eye(3) * SURE_M**2, (count, 3, 3))
    sigma_m = np.sqrt(np.maximum(np.trace(before, axis1=1, axis2=2) / 3.0, 0.0))
    grown_m = np.maximum(np.minimum(sigma_m + speed_m_s * max(seconds, 0.0), WIDEST_M), sigma_m)
    return before + (grown_m**2 - sigma_m**2)[:, None, None] * np.eye(3)


def kept(stamp_ns: int, prior: DloState, speed_m_s: float) -> TargetPoints:
    """The prior's nodes as targets, none visible, health 0, their covariance grown since the prior was observed."""
    seconds = (stamp_ns - prior.observed_stamp_ns) / 1e9 if prior.observed_stamp_ns > 0 else 0.0
    return TargetPoints(
        stamp_ns=max(stamp_ns, prior.observed_stamp_ns),
        nodes_world=prior.nodes_world.copy(),
        visible=np.zeros(len(prior.nodes_world), dtype=np.bool_),
        covariance=grown_covariance(prior, seconds, speed_m_s),
        health=0.0,
    )
