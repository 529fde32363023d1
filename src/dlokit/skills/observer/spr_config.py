"""Settings of structure preserved registration."""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.mixture_config import MixtureConfig


@dataclass(frozen=True, kw_only=True)
class SprConfig(MixtureConfig):
    """Structure preserved registration, as in the paper: keeps the local shape, also where little is seen."""

    name: ClassVar[str] = "spr"

    beta_m: float = 0.94
    """Width of the Gaussian kernel [m]: nodes nearer than this move alike."""
    lambda_per_m2: float = 2000.0
    """Weight of the smoothness of the motion against the fit at the first iteration [1/m²]."""
    outlier_weight: float = 0.032
    """w, the share of points expected to belong to nothing, from 0 to below 1."""
    initial_sigma_m: float = 0.043
    """Standard deviation of the Gaussians at the start [m]; 0 takes the paper's, the mean distance of all pairs."""
    tau_per_m2: float = 4e5
    """tau, weight of the local structure against the fit at the first iteration [1/m²]; 0 leaves it out."""
    neighbours: int = 3
    """K, how many nearest nodes a node is put together from."""
    regularisation: float = 1e-3
    """What is added to the diagonal of the local Gram matrices, as a share of their trace."""
    tau_annealing: float = 0.88
    """In iteration k, from 0, tau counts `tau_annealing` to the power of k; above 0, at most 1 (constant)."""
    lambda_annealing: float = 0.99
    """In iteration k, from 0, lambda counts `lambda_annealing` to the power of k; above 0, at most 1 (constant)."""

    def build(self) -> ObserverStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.observer.spr import Spr

        return Spr(self)
