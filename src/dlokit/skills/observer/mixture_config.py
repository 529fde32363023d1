"""Settings of the mixture that CPD and SPR fit."""

from dataclasses import dataclass, field

from dlokit.skills.observer.visibility_config import VisibilityConfig


@dataclass(frozen=True, kw_only=True)
class MixtureConfig:
    """The fit of a mixture whose nodes move coherently."""

    beta_m: float = 0.83
    """Width of the Gaussian kernel [m]: nodes nearer than this move alike."""
    lambda_per_m2: float = 2300.0
    """Weight of the smoothness of the motion against the fit [1/m²]."""
    outlier_weight: float = 0.023
    """w, the share of points expected to belong to nothing, from 0 to below 1."""
    initial_sigma_m: float = 0.036
    """Standard deviation of the Gaussians at the start [m]; about the largest motion between two clouds.
    0 takes the paper's, the mean distance of all pairs, for a registration from far."""
    smallest_sigma_m: float = 0.002
    """The iteration ends below this standard deviation [m]; about the noise of the cloud."""
    tolerance: float = 1e-3
    """The iteration ends when sigma² changes by a smaller share than this."""
    max_iterations: int = 60
    """The iteration ends at the latest after so many steps."""
    max_points: int = 2000
    """Larger clouds are thinned, evenly over their index, to so many points before registration."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """When a node counts as seen."""

    def __post_init__(self) -> None:
        if self.beta_m <= 0.0 or self.lambda_per_m2 <= 0.0:
            raise ValueError(f"beta_m {self.beta_m:g} and lambda_per_m2 {self.lambda_per_m2:g}: both must be above 0")
        if not 0.0 <= self.outlier_weight < 1.0:
            raise ValueError(f"outlier_weight {self.outlier_weight:g}: from 0 to below 1 is allowed")
