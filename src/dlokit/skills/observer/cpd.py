"""Coherent point drift: the nodes are centroids of a Gaussian mixture that is fitted to the cloud.

Myronenko, Song: *Point Set Registration: Coherent Point Drift*, TPAMI 32 (2010), doi 10.1109/TPAMI.2010.46;
the non-rigid algorithm of its Fig. 4, with its symbols; the loop is in `mixture`.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.skills.observer.mixture import MixtureConfig, Registration, Weights, fit_mixture, thinned
from dlokit.skills.observer.visibility import RADIUS_M, targets_at
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class CpdConfig(MixtureConfig):
    """Coherent point drift, as in the paper: close to the curve, but nodes may slide along it."""

    name: ClassVar[str] = "cpd"

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """The strategy with these settings."""
        return Cpd(self, dlo.radius_m)


PLIABLE = CpdConfig(beta_m=0.12, lambda_per_m2=300.0, outlier_weight=0.05, initial_sigma_m=0.04, max_points=700)
"""A registration that follows every bend, for observers that correct the nodes that slide along the curve."""


def register(X: Float64Array, Y: Float64Array, config: CpdConfig) -> Registration:
    """Move the nodes Y (M, 3) [m] onto the cloud X (N, 3) [m], N >= 1; the algorithm of Fig. 4.

    E-step eq. 6, M-step eq. 22: (d(P1) G + lambda sigma² I) W = P X - d(P1) Y; sigma² by eq. 23.
    """
    weights = Weights(lambda_per_m2=config.lambda_per_m2)
    return fit_mixture(X, Y, config, lambda iteration: weights)


class Cpd:
    """Coherent point drift as an observer: each cloud is registered from the prior's nodes."""

    def __init__(self, config: CpdConfig | None = None, radius_m: float = RADIUS_M) -> None:
        self._config, self._radius_m = config or CpdConfig(), radius_m

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The prior's nodes, drifted coherently onto the cloud. Health is the fraction of points near them."""
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        result = register(thinned(points, self._config.max_points), prior.nodes_world, self._config)
        return targets_at(result.nodes, points, seen, prior.topology, self._radius_m)
