"""The shift of the camera along the table, learned from where the rod lies after the robot has let it go.

The table tells height and tilt of the camera (`table`), not where it stands. The tool's pose is exact, and a rod that
was let go near the table stays where it was between the fingers: if it is seen beside that place, across the fingers,
the camera is off by as much. Grasps at several yaws give both directions.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.errors import ConfigError
from dlokit.skills.perception.releases import Release
from dlokit.types.pose import Pose

Array = NDArray[np.float64]

_ALONG_M, _ACROSS_M = 0.02, 0.025
"""Half sizes of the window around the place, along the rod and across it [m]."""
_ROUNDS = 4


@dataclass(frozen=True, kw_only=True)
class ShiftConfig:
    """Correction of the camera's place along the table, by where the rod lies after a release."""

    correct: bool = False
    """Whether to correct it. Off, because few releases tell less than the springing back of the rope hides; worth it in
    long tasks with grasps at many yaws. The tool's pose must be more exact than the camera's."""
    prior_m: float = 0.004
    """How far the camera may be off along each axis before any release (standard deviation) [m]."""
    noise_m: float = 0.002
    """How far the rod springs away across the fingers when they open (standard deviation) [m]."""
    lifted_noise_m: float = 0.003
    """The same for a rod that hung from them before: laid down, it is bent and springs farther."""
    highest_m: float = 0.03
    """The tool's height above which a rod that is let go falls, and may come to rest elsewhere [m]."""
    least_points: int = 8
    """Fewer points around the place say nothing."""
    scatter_m: float = 0.004
    """Points that scatter more across the rod (median) are of several stretches, and say nothing [m]."""
    gate: float = 3.0
    """A measurement off by more of its standard deviations than this is a slip, and not believed."""

    def __post_init__(self) -> None:
        for name in ("prior_m", "noise_m", "lifted_noise_m", "scatter_m", "gate"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"perception.shift.{name} is {getattr(self, name)}; it must be above 0.")


@dataclass(frozen=True)
class Offset:
    """How far the rod is seen beside the place where it was let go."""

    across_world: Array  # (2,) unit vector across the fingers, along the table
    offset_m: float
    sigma_m: float


@dataclass(frozen=True)
class Shift:
    """How far points are seen beside where they are, as far as it is known."""

    mean_m: Array  # (2,) along x and y of the world
    covariance_m2: Array  # (2, 2)

    @classmethod
    def unknown(cls, config: ShiftConfig) -> "Shift":
        """Before any release."""
        return cls(np.zeros(2), np.eye(2) * config.prior_m**2)

    def after(self, measured: Offset, gate: float) -> "Shift":
        """The estimate (Kalman filter) after a measurement in points corrected by it; outliers change nothing."""
        h, P = measured.across_world, self.covariance_m2
        variance = float(h @ P @ h) + measured.sigma_m**2
        if abs(measured.offset_m) > gate * np.sqrt(variance):
            return self
        gain = P @ h / variance
        return Shift(self.mean_m + gain * measured.offset_m, P - np.outer(gain, h @ P))

    def corrected(self, pose: Pose) -> Pose:
        """A believed T_world_camera, moved so that points are seen where they are."""
        return Pose(position_m=pose.position_m - np.append(self.mean_m, 0.0), wxyz=pose.wxyz)


def offset_after_release(points_world: NDArray[np.floating], release: Release, config: ShiftConfig) -> Offset | None:
    """How far a cloud (N, 3) [m] passes the place of a release; None when it does not say.

    Fitted is a straight stretch of rod, robustly, and read off where the middle between the fingers was.
    """
    x, y, _ = geometry.transform(geometry.inverse(release.T_world_tcp), points_world).T
    near = (np.abs(x) < _ALONG_M) & (np.abs(y) < _ACROSS_M)
    if np.count_nonzero(near) < config.least_points:
        return None
    J, y = np.column_stack([np.ones(np.count_nonzero(near)), x[near]]), y[near]
    weights = np.ones(len(y))
    line, residual = np.zeros(2), y
    for _ in range(_ROUNDS):
        # einsum stays on this thread; the prior of a few points keeps a short stretch from turning.
        H = np.einsum("k,ki,kj->ij", weights, J, J) + np.diag([0.0, 5e-4])
        line = np.linalg.solve(H, np.einsum("k,ki,k->i", weights, J, y))
        residual = np.abs(y - J @ line)
        weights = np.minimum(1.0, 0.002 / np.maximum(residual, 1e-9))
    if float(np.median(residual)) > config.scatter_m:
        return None
    across = geometry.rotation(release.T_world_tcp)[:2, 1]
    length = float(np.linalg.norm(across))
    sigma_m = config.lifted_noise_m if release.lifted else config.noise_m
    return Offset(across / length, float(line[0]) / length, sigma_m)
