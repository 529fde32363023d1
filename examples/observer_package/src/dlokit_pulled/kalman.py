"""A Kalman filter with a nearly constant velocity for each node: an observer with a memory.

The state of a node is its position and its velocity; the three axes are independent and have one covariance (2, 2). The
filter predicts from the prior's nodes, measures with `pulled` from there (each point pulls the nearest place of the
rod), and corrects. The prior has the positions already, perhaps corrected by the model or moved with an arm, so the
memory holds what the prior lacks: the velocities and the covariances.
"""

from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import nothing_seen
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation
from dlokit_pulled.observer import Pulled, PulledConfig

Array = NDArray[np.float64]

_LONGEST_S = 0.2
"""After a longer time between two clouds nothing is known of the velocities [s]."""
_REMEMBERED_S = 0.2
"""Time in which a velocity that no cloud confirms falls to a third [s]: a cloud does not show how nodes slide along the
rod, and with a constant velocity they would slide on."""
_BEGIN = np.diag([0.03**2, 0.3**2])
"""Covariance of a node of which nothing is known [m², m²/s²]: it has moved by 3 cm, at up to 0.3 m/s."""


@dataclass(frozen=True, kw_only=True)
class KalmanConfig:
    """Settings of the Kalman filter with constant velocity."""

    name: ClassVar[str] = "kalman"

    noise_m: float = 0.003
    """Standard deviation of a visible node that is measured [m]; larger: smoother and slower."""
    hidden_noise_m: float = 0.01
    """Standard deviation of a hidden node, which is measured by its neighbours [m]."""
    acceleration_m_s2: float = 5.0
    """Standard deviation of a node's acceleration [m/s²]; larger: quicker and less smooth."""

    def __post_init__(self) -> None:
        if min(self.noise_m, self.hidden_noise_m, self.acceleration_m_s2) <= 0.0:
            raise ValueError("noise_m, hidden_noise_m and acceleration_m_s2 must be above 0")

    def build(self, dlo: BelievedDlo) -> "Kalman":
        """Build the observer."""
        return Kalman(self)


class Kalman:
    """Predicts the nodes with their velocities, measures them with `pulled`, and corrects both."""

    def __init__(self, config: KalmanConfig) -> None:
        self._config, self._measure = config, Pulled(PulledConfig())

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """Target points with their covariance, and the memory for the next cloud."""
        if len(seen.points_world) == 0:
            return nothing_seen(seen, prior)
        # The model may have moved the prior with an arm until its stamp: the prediction goes on from there.
        seconds = (seen.stamp_ns - prior.stamp_ns) / 1e9
        predicted, velocity, P = self._predicted(prior, seconds)
        measured = self._measure.estimate(seen, msgspec.structs.replace(prior, nodes_world=predicted))
        noise_m = np.where(measured.visible, self._config.noise_m, self._config.hidden_noise_m)
        gain = P[:, :, 0] / (P[:, 0, 0] + noise_m**2)[:, None]  # (M, 2)
        off = measured.nodes_world - predicted
        nodes, velocity = predicted + gain[:, :1] * off, velocity + gain[:, 1:] * off
        corrected = P - gain[:, :, None] * P[:, :1, :]
        return msgspec.structs.replace(
            measured,
            nodes_world=nodes,
            covariance=corrected[:, 0, 0, None, None] * np.eye(3),
            memory={"velocity_m_s": velocity, "covariance": corrected},
        )

    def _predicted(self, prior: DloState, seconds: float) -> tuple[Array, Array, Array]:
        """Nodes (M, 3) [m], velocities (M, 3) [m/s] and covariances (M, 2, 2) at the time of the cloud."""
        count, memory = len(prior.nodes_world), prior.memory
        known = {"velocity_m_s": (count, 3), "covariance": (count, 2, 2)}
        # A memory may be of another number of nodes, or of another observer.
        if {name: array.shape for name, array in memory.items()} != known or not 0.0 <= seconds <= _LONGEST_S:
            return prior.nodes_world, np.zeros((count, 3)), np.tile(_BEGIN, (count, 1, 1))
        kept = np.exp(-seconds / _REMEMBERED_S)
        F = np.array([[1.0, seconds], [0.0, kept]])
        push = np.array([seconds**2 / 2.0, seconds])
        Q = self._config.acceleration_m_s2**2 * np.outer(push, push)
        nodes = prior.nodes_world + seconds * memory["velocity_m_s"]
        return nodes, kept * memory["velocity_m_s"], F @ memory["covariance"] @ F.T + Q
