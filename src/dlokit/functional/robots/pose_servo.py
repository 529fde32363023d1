"""Following a moving tool pose by damped least squares, within joint limits. Pure.

Nakamura and Hanafusa, "Inverse kinematic solutions with singularity robustness", ASME J. Dyn. Sys. 1986, Eq. 15.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.panda_kinematics import tcp_jacobian, tcp_matrices
from dlokit.types.pose import Pose
from dlokit.types.robot import JointLimits

Array = NDArray[np.float64]

_GAIN_PER_S = 6.0
_DAMPING = 0.02


class PoseServo:
    """Joint angles that draw the tool towards the last target, a step at a time."""

    def __init__(self, q_rad: Array, limits: JointLimits, period_s: float, T_world_base: Pose | None = None) -> None:
        self._q = np.array(q_rad, dtype=np.float64)
        self._dq = np.zeros_like(self._q)
        self._limits = limits
        self._period_s = period_s
        self._T_base_world = None if T_world_base is None else geometry.inverse(T_world_base)
        self._target: Array | None = None

    def aim(self, T_world_tcp: Pose) -> None:
        """Draw the tool there from now on."""
        T = T_world_tcp if self._T_base_world is None else geometry.compose(self._T_base_world, T_world_tcp)
        self._target = geometry.matrix(T)

    def step(self) -> tuple[Array, Array]:
        """Joint angles (7,) [rad] and velocities (7,) [rad/s] to be at, one period later."""
        wanted = np.zeros(7) if self._target is None else self._wanted(self._target)
        limits, dt = self._limits, self._period_s
        wanted *= min(1.0, float(np.min(limits.velocity_rad_s / np.maximum(np.abs(wanted), 1e-9))))
        # Half the acceleration, so that the jerk of one step to the next stays within bounds as well.
        change = np.clip(
            wanted - self._dq, -0.5 * limits.acceleration_rad_s2 * dt, 0.5 * limits.acceleration_rad_s2 * dt
        )
        dq = self._dq + change
        q = np.clip(self._q + dq * dt, limits.position_lower_rad, limits.position_upper_rad)
        self._dq, self._q = (q - self._q) / dt, q
        return self._q.copy(), self._dq.copy()

    def _wanted(self, target: Array) -> Array:
        now = tcp_matrices(self._q)[0]
        turn = Rotation.from_matrix(target[:3, :3] @ now[:3, :3].T).as_rotvec()
        twist = _GAIN_PER_S * np.concatenate([target[:3, 3] - now[:3, 3], turn])
        J = tcp_jacobian(self._q)
        return J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(6), twist)
