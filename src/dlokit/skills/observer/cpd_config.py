"""Settings of coherent point drift."""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.mixture_config import MixtureConfig


@dataclass(frozen=True, kw_only=True)
class CpdConfig(MixtureConfig):
    """Coherent point drift, as in the paper: close to the curve, but nodes may slide along it."""

    name: ClassVar[str] = "cpd"

    def build(self) -> ObserverStrategy:
        """The strategy with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.observer.cpd import Cpd

        return Cpd(self)


def pliable() -> CpdConfig:
    """Registration that follows every bend; what slides along the curve, the anchors put back. CPD alone is stiffer."""
    return CpdConfig(beta_m=0.12, lambda_per_m2=300.0, outlier_weight=0.05, initial_sigma_m=0.04, max_points=700)
