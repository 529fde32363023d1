"""Inverse kinematics of the Panda: from a tool pose to joint angles. Pure; usable without any component.

A gripper that points straight down has a closed solution with the elbow in the vertical plane through tool and base
(q3 = q5 = 0), continuous over the whole table. Any other pose is solved by differential inverse kinematics (mink,
quadratic programmes by daqp), from several seeds, nearest solution first.

The gripper is the same turned by half a turn, so a pose stands for two; `Yaw` says which of them is meant.
"""

import enum
import math
from functools import cached_property

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.arm.panda import PANDA_DH, PANDA_FLANGE_M, PANDA_HOME_Q_RAD, PANDA_LIMITS, PANDA_TCP_M
from dlokit.description.arm.panda_model import add_panda
from dlokit.errors import SkillFailure
from dlokit.motion import forward_kinematics
from dlokit.motion.tool_path import half_turned, points_down
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotReason

_SHOULDER_HEIGHT_M = PANDA_DH[0].d_m
_ELBOW_OFFSET_M = PANDA_DH[3].a_m
_UPPER_ARM_M, _FOREARM_M = PANDA_DH[2].d_m, PANDA_DH[4].d_m
_WRIST_OFFSET_M = PANDA_DH[6].a_m
_HAND_M = PANDA_FLANGE_M + PANDA_TCP_M
_UPPER = float(np.hypot(_ELBOW_OFFSET_M, _UPPER_ARM_M))
_FORE = float(np.hypot(_ELBOW_OFFSET_M, _FOREARM_M))
# Angle at the elbow, between shoulder and wrist, that the offsets leave when joint 4 is at zero.
_ELBOW_AT_ZERO = float(np.arctan2(_UPPER_ARM_M, _ELBOW_OFFSET_M) + np.arctan2(_FOREARM_M, _ELBOW_OFFSET_M))
_LENGTH_M = _UPPER + _FORE + _WRIST_OFFSET_M + _HAND_M
"""No posture brings the tool centre point farther from the shoulder [m]."""
_LIMIT_MARGIN_RAD = 0.01  # that solutions keep from the limits of position
_ITERATIONS = 40  # Newton steps from one seed
_POSITION_TOLERANCE_M = 1e-5
_ROTATION_TOLERANCE_RAD = 1e-4


class Yaw(enum.Enum):
    """Which of the two gripper poses that differ by half a turn is meant."""

    EXACT = "exact"
    """The one given."""
    EITHER = "either"
    """The one given where the arm reaches it, else the other."""


class PandaKinematics:
    """Forward and inverse kinematics of one Panda; poses are of its tool centre point, in the world."""

    def __init__(self, T_world_base: Pose | None = None) -> None:
        self.T_world_base = T_world_base
        self._T_base_world = None if T_world_base is None else geometry.inverse(T_world_base)
        self.lower_rad = PANDA_LIMITS.position_lower_rad + _LIMIT_MARGIN_RAD
        self.upper_rad = PANDA_LIMITS.position_upper_rad - _LIMIT_MARGIN_RAD
        shoulder = np.array([[0.0, 0.0, _SHOULDER_HEIGHT_M]])
        self._shoulder_world: list[float] = (
            shoulder if T_world_base is None else geometry.transform(T_world_base, shoulder)
        )[0].tolist()

    def __reduce__(self) -> tuple[object, ...]:
        """Pickles its base pose only: the solver is built again when it is needed."""
        return (PandaKinematics, (self.T_world_base,))

    def forward(self, q_rad: ArrayLike) -> Pose:
        """``T_world_tcp`` at joint angles (7,) [rad]."""
        T = forward_kinematics.tcp_pose(q_rad)
        return T if self.T_world_base is None else geometry.compose(self.T_world_base, T)

    def inverse(self, T_world_tcp: Pose, near_q_rad: ArrayLike | None = None, yaw: Yaw = Yaw.EXACT) -> Float64Array:
        """Joint angles (7,) [rad] that bring the tool to a pose, within the limits, in the posture of `near_q_rad`.

        Raises `SkillFailure` ``unreachable`` when there are none.
        """
        self.check_length(T_world_tcp, yaw)
        near = PANDA_HOME_Q_RAD if near_q_rad is None else np.asarray(near_q_rad, dtype=np.float64)
        T = T_world_tcp if self._T_base_world is None else geometry.compose(self._T_base_world, T_world_tcp)
        solve = self._pointing_down if points_down(T) else self._differential
        for pose in (T,) if yaw is Yaw.EXACT else (T, half_turned(T)):
            q = solve(pose, near)
            if q is not None:
                return q
        raise SkillFailure(RobotReason.UNREACHABLE, _explain(T_world_tcp, yaw))

    def reachable(self, T_world_tcp: Pose, yaw: Yaw = Yaw.EXACT) -> bool:
        """Whether joint angles within the limits bring the tool there. Takes 0.1 ms for a gripper pointing down."""
        try:
            self.inverse(T_world_tcp, yaw=yaw)
        except SkillFailure:
            return False
        return True

    def check_length(self, T_world_tcp: Pose, yaw: Yaw = Yaw.EXACT) -> None:
        """Raise `SkillFailure` ``unreachable`` on a pose farther from the shoulder than the stretched arm is long."""
        if not math.dist(T_world_tcp.position_m.tolist(), self._shoulder_world) <= _LENGTH_M:
            raise SkillFailure(RobotReason.UNREACHABLE, _explain(T_world_tcp, yaw))

    def _inside(self, q: Float64Array) -> bool:
        return bool(np.all(q >= self.lower_rad) and np.all(q <= self.upper_rad))

    def _pointing_down(self, T_base_tcp: Pose, near: Float64Array) -> Float64Array | None:
        """The closed solution with q3 = q5 = 0."""
        x, y, z = T_base_tcp.position_m
        across, up = np.hypot(x, y) - _WRIST_OFFSET_M, z + _HAND_M - _SHOULDER_HEIGHT_M
        distance_squared = across**2 + up**2
        cosine = (_UPPER**2 + _FORE**2 - distance_squared) / (2 * _UPPER * _FORE)
        if abs(cosine) > 1.0:
            return None
        bend = 2 * np.pi - _ELBOW_AT_ZERO - np.arccos(cosine)
        # Where the wrist is seen from the shoulder while joint 2 is at zero, as an angle from the vertical.
        forward = _ELBOW_OFFSET_M - _ELBOW_OFFSET_M * np.cos(bend) + _FOREARM_M * np.sin(bend)
        upward = _UPPER_ARM_M + _ELBOW_OFFSET_M * np.sin(bend) + _FOREARM_M * np.cos(bend)
        q1, q2 = np.arctan2(y, x), np.arctan2(across, up) - np.arctan2(forward, upward)
        q7 = q1 + np.pi / 4 - _heading(T_base_tcp)
        # A whole turn more or less is the same pose; near the limit the previous angle decides.
        q7 = min((q7 + turn for turn in (-4 * np.pi, -2 * np.pi, 0.0, 2 * np.pi)), key=lambda a: abs(a - near[6]))
        if not self.lower_rad[6] <= q7 <= self.upper_rad[6]:
            q7 = np.arctan2(np.sin(q7), np.cos(q7))
        q = np.array([q1, q2, 0.0, -bend, 0.0, q2 + bend, q7])
        return q if self._inside(q) else None

    def _differential(self, T_base_tcp: Pose, near: Float64Array) -> Float64Array | None:
        """The solution by mink that lies nearest to `near`."""
        upright = geometry.downward(T_base_tcp.position_m, _heading(T_base_tcp))
        seeds = [near, PANDA_HOME_Q_RAD]
        for pose in (upright, half_turned(upright)):
            below = self._pointing_down(pose, near)
            if below is not None:
                seeds.append(below)
        for seed in seeds:
            q = self._solver.solve(T_base_tcp, seed)
            if q is not None and self._inside(q):
                return q
        return None

    @cached_property
    def _solver(self) -> "_DifferentialSolver":
        return _DifferentialSolver()


def _explain(T: Pose, yaw: Yaw) -> str:
    place = ", ".join(f"{value:.3f}" for value in T.position_m)
    posture = "straight down" if points_down(T) else "at that angle"
    way = "" if yaw is Yaw.EITHER else ", turned that way round"
    return (
        f"the tool cannot be at ({place}) m with the gripper {posture}{way}; straight down over the table it reaches "
        "0.27 to 0.79 m from the base and joint 7 turns by 166° either way; move the target nearer or turn less"
    )


def _heading(T: Pose) -> float:
    """Direction of the x axis in the horizontal plane [rad]."""
    w, x, y, z = T.wxyz
    return float(np.arctan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z))


class _DifferentialSolver:
    """Newton steps on the tool pose by mink, with a weak pull to the seed's posture."""

    def __init__(self) -> None:
        spec = mujoco.MjSpec()
        add_panda(spec, visual=False)
        model = spec.compile()
        self._configuration = mink.Configuration(model)
        self._tool = mink.FrameTask("panda/tcp", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-6)
        self._posture = mink.PostureTask(model, cost=1e-4)
        self._limits = [mink.ConfigurationLimit(model)]

    def solve(self, T_base_tcp: Pose, seed: Float64Array) -> Float64Array | None:
        """Joint angles (7,), or None when the steps do not converge."""
        start = np.concatenate([seed, np.zeros(2)])
        self._configuration.update(start)
        self._tool.set_target(mink.SE3(np.concatenate([T_base_tcp.wxyz, T_base_tcp.position_m])))
        self._posture.set_target(start)
        for _ in range(_ITERATIONS):
            error = self._tool.compute_error(self._configuration)
            if (
                np.linalg.norm(error[:3]) < _POSITION_TOLERANCE_M
                and np.linalg.norm(error[3:]) < _ROTATION_TOLERANCE_RAD
            ):
                return self._configuration.q[:7].copy()
            try:
                velocity = mink.solve_ik(
                    self._configuration, [self._tool, self._posture], 1.0, solver="daqp", limits=self._limits
                )
            except mink.NoSolutionFound:
                return None
            self._configuration.integrate_inplace(velocity, 1.0)
        return None
