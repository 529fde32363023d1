"""Structure preserved registration: coherent point drift that keeps the shape's local structure.

Tang, Tomizuka: *Track deformable objects from point clouds with structure preserved registration*, IJRR
(2019), doi 10.1177/0278364919841431; before it Tang, Wang, Tomizuka, ICRA 2017. Symbols as in `mixture`, and
M the structure matrix of the previous nodes, tau the weight of the local structure, lambda of the global one.

It maximises the likelihood of the cloud less  lambda/2 tr Wᵀ G W + tau/2 tr Tᵀ M T,  T = Y + G W: motion
is smooth over the whole shape, and each node stays the same combination of its neighbours.

The local structure of a shape, each node as a combination of its neighbours:
Roweis, Saul: *Nonlinear Dimensionality Reduction by Locally Linear Embedding*, Science 290 (2000),
doi 10.1126/science.290.5500.2323. Symbols: Y (M, D) the nodes of the reference shape, K the number of
neighbours, W (M, M) the weights, row i those of node i.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from dlokit.ranges import NotNegative, Positive
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.skills.observer.mixture import MixtureConfig, OutlierWeight, Registration, Weights, fit_mixture, thinned
from dlokit.skills.observer.visibility import RADIUS_M, targets_at
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false


@dataclass(frozen=True, kw_only=True)
class SprConfig(MixtureConfig):
    """Structure preserved registration, as in the paper: keeps the local shape, also where little is seen."""

    name: ClassVar[str] = "spr"

    beta_m: Positive = 0.94
    """Width of the Gaussian kernel [m]: nodes nearer than this move alike."""
    lambda_per_m2: Positive = 2000.0
    """Weight of the smoothness of the motion against the fit at the first iteration [1/m²]."""
    outlier_weight: OutlierWeight = 0.032
    """w, the expected fraction of outliers among the points, from 0 to below 1."""
    initial_sigma_m: NotNegative = 0.043
    """Standard deviation of the Gaussians at the start [m]; 0: the paper's value, the mean distance of all pairs."""
    tau_per_m2: float = 4e5
    """tau, weight of the local structure against the fit at the first iteration [1/m²]; 0: none."""
    neighbours: int = 3
    """K, the number of nearest nodes in the combination for a node."""
    regularisation: float = 1e-3
    """Regularisation on the diagonal of the local Gram matrices, as a fraction of their trace."""
    tau_annealing: float = 0.88
    """Factor on tau from one iteration to the next; above 0, at most 1 (constant)."""
    lambda_annealing: float = 0.99
    """Factor on lambda from one iteration to the next; above 0, at most 1 (constant)."""

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """The strategy with these settings."""
        return Spr(self, dlo.radius_m)


def lle_weights(Y: Float64Array, neighbours: int, regularisation: float) -> Float64Array:
    """W (M, M) that minimises sum_i |y_i - sum_j w_ij y_j|² with sum_j w_ij = 1, w_ij = 0 off the neighbours.

    With z_j = y_j - y_i of node i's K nearest nodes and the local Gram matrix C_jk = z_j · z_k, the weights
    are those of C w = 1, scaled to the sum 1. More neighbours than dimensions, or neighbours on a line, make
    C singular: `regularisation` times the trace of C is added to its diagonal, so that the weights do not
    depend on the scale of the shape. With fewer than K + 1 nodes, every node is a neighbour of every other.
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


def structure_matrix(W: Float64Array) -> Float64Array:
    """(I - W)ᵀ (I - W) (M, M): tr Tᵀ M T is the squared error of T's nodes as combinations by W."""
    rest = np.eye(len(W)) - W
    return rest.T @ rest


def _nearest(Y: Float64Array, count: int) -> NDArray[np.int64]:
    """The `count` nearest other nodes of each node, (M, count)."""
    _, index = scipy.spatial.KDTree(Y).query(Y, k=count + 1)
    others = np.asarray(index, dtype=np.int64)
    itself = others == np.arange(len(Y))[:, None]
    itself[~itself.any(axis=1), -1] = True  # where nodes coincide, the node itself may not be listed
    return others[~itself].reshape(len(Y), count)


def register(X: Float64Array, Y: Float64Array, config: SprConfig) -> Registration:
    """Move the nodes Y (M, 3) [m] onto the cloud X (N, 3) [m], N >= 1.

    `CoherentMotion` solves the M-step, from the derivative by W at fixed P. lambda and tau are annealed from their
    settings in every registration.
    """
    # The weights of a row sum to one: M Y does not change with the origin, which `fit_mixture` moves.
    M = structure_matrix(lle_weights(Y, config.neighbours, config.regularisation))

    def weights(iteration: int) -> Weights:
        return Weights(
            lambda_per_m2=config.lambda_per_m2 * config.lambda_annealing**iteration,
            tau_per_m2=config.tau_per_m2 * config.tau_annealing**iteration,
        )

    return fit_mixture(X, Y, config, weights, M)


class Spr:
    """Structure preserved registration as an observer: each cloud is registered from the prior's nodes.

    The prior's shape is the reference of the local structure, as in the paper, where a simulation corrects
    the nodes between two clouds. Nothing else is kept from one cloud to the next.
    """

    def __init__(self, config: SprConfig | None = None, radius_m: float = RADIUS_M) -> None:
        self._config, self._radius_m = config or SprConfig(), radius_m

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The prior's nodes, registered on the cloud. Health is the fraction of points near them."""
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        result = register(thinned(points, self._config.max_points), prior.nodes_world, self._config)
        return targets_at(result.nodes, points, seen, prior.topology, self._radius_m)
