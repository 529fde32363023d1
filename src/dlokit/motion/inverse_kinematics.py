"""Inverse kinematics of an arm: from a tool pose to joint angles. Pure; usable without any component.

The solver iterates from several seeds, the nearest first: by Newton's method for an arm of six joints, by differential
inverse kinematics within the limits (mink, quadratic programmes by daqp) for an arm with more. For an arm of Franka's
kind and a gripper that points straight down, the solution is in closed form, with the elbow in the vertical plane
through tool and base (q3 = q5 = 0), and continuous over the whole table.

The gripper is symmetric: half a turn does not change it, so two poses are equivalent; `Yaw` selects one.
"""

import enum
import math
from collections.abc import Iterator
from functools import cache, cached_property

import mink
import mujoco
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.arm.model import ArmModel, FrankaDimensions
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.errors import SkillFailure
from dlokit.motion import forward_kinematics
from dlokit.motion.tool_path import half_turned, points_down
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotReason

_POSE_NUMBERS = 6  # of a tool: an arm with more joints can reach a pose in many postures
_LIMIT_MARGIN_RAD = 0.01  # that solutions keep from the limits of position
_ITERATIONS = 40  # Newton steps from one seed
_NEARLY_DOWN_RAD = 0.1
"""Largest inclination of a tool that points nearly down [rad], as in every grasp on a slightly inclined base."""
_NEWTON_STEPS = 30
_DAMPING = 1e-6  # of the squared Jacobian; singular poses are approached slowly
_LARGEST_STEP_RAD = 0.5  # of a joint: the linear model holds no farther
_POSITION_TOLERANCE_M = 1e-5
_ROTATION_TOLERANCE_RAD = 1e-4


class Yaw(enum.Enum):
    """Selects one of the two equivalent gripper poses that differ by half a turn."""

    EXACT = "exact"
    """The given pose."""
    EITHER = "either"
    """The given pose if the arm reaches it, else the pose half a turn away."""


class ArmKinematics:
    """Forward and inverse kinematics of one arm; poses are of its tool centre point, in the world."""

    def __init__(self, arm: ArmModel, T_world_base: Pose | None = None) -> None:
        self.arm = arm
        self.T_world_base = T_world_base
        self._T_base_world = None if T_world_base is None else geometry.inverse(T_world_base)
        self.lower_rad = arm.limits.position_lower_rad + _LIMIT_MARGIN_RAD
        self.upper_rad = arm.limits.position_upper_rad - _LIMIT_MARGIN_RAD
        self._down = (
            None if arm.franka is None else _FrankaPointingDown(arm, arm.franka, self.lower_rad, self.upper_rad)
        )
        # The second joint's axis passes through the shoulder, from which the arm stretches.
        T_base_shoulder = arm.joints[0].T_parent_link @ arm.joints[1].T_parent_link
        shoulder = T_base_shoulder[None, :3, 3]
        self._shoulder_world: list[float] = (
            shoulder if T_world_base is None else geometry.transform(T_world_base, shoulder)
        )[0].tolist()

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the arm and its base pose only; the solver is built again on demand."""
        return (ArmKinematics, (self.arm, self.T_world_base))

    def forward(self, q_rad: ArrayLike) -> Pose:
        """``T_world_tcp`` at joint angles (J,) [rad]."""
        T = forward_kinematics.tcp_pose(self.arm, q_rad)
        return T if self.T_world_base is None else geometry.compose(self.T_world_base, T)

    def inverse(self, T_world_tcp: Pose, near_q_rad: ArrayLike | None = None, yaw: Yaw = Yaw.EXACT) -> Float64Array:
        """Joint angles (J,) [rad] that bring the tool to a pose, within the limits, in the posture of `near_q_rad`.

        Raises `SkillFailure` ``unreachable`` if no such angles are found.
        """
        self.check_length(T_world_tcp, yaw)
        near = self.arm.home_q_rad if near_q_rad is None else np.asarray(near_q_rad, dtype=np.float64)
        T = T_world_tcp if self._T_base_world is None else geometry.compose(self._T_base_world, T_world_tcp)
        for pose in (T,) if yaw is Yaw.EXACT else (T, half_turned(T)):
            if self._down is not None and points_down(T):
                q = self._down.solve(pose, near)
            elif self._down is not None and self._T_base_world is not None and _nearly_down(T):
                q = self._inclined(pose, self._down, near)
            else:
                q = self._differential(pose, near)
            if q is not None:
                return q
        raise SkillFailure(RobotReason.UNREACHABLE, self._explain(T_world_tcp, yaw))

    def reachable(self, T_world_tcp: Pose, yaw: Yaw = Yaw.EXACT) -> bool:
        """Whether joint angles within the limits bring the tool to this pose.

        Takes 0.1 ms if the closed solution for a gripper pointing down applies.
        """
        try:
            self.inverse(T_world_tcp, yaw=yaw)
        except SkillFailure:
            return False
        return True

    def check_length(self, T_world_tcp: Pose, yaw: Yaw = Yaw.EXACT) -> None:
        """Raise `SkillFailure` ``unreachable`` if a pose is beyond the reach of the stretched arm from the shoulder."""
        if not math.dist(T_world_tcp.position_m.tolist(), self._shoulder_world) <= self.length_m:
            raise SkillFailure(RobotReason.UNREACHABLE, self._explain(T_world_tcp, yaw))

    @cached_property
    def length_m(self) -> float:
        """Largest distance of the tool centre point from the shoulder in any posture [m]."""
        if self.arm.franka is not None:
            return _franka_length_m(self.arm, self.arm.franka)
        links = [joint.T_parent_link[:3, 3] for joint in self.arm.joints[2:]]
        return float(sum(np.linalg.norm(offset) for offset in (*links, self.arm.T_last_tcp[:3, 3])))

    def _inside(self, q: Float64Array) -> bool:
        return bool(np.all(q >= self.lower_rad) and np.all(q <= self.upper_rad))

    def _inclined(self, T_base_tcp: Pose, down: "_FrankaPointingDown", near: Float64Array) -> Float64Array | None:
        """The solution nearest to the closed one for a tool pointing straight down, for an arm on an inclined base."""
        upright = down.solve(geometry.downward(T_base_tcp.position_m, heading(T_base_tcp)), near)
        if upright is None:
            return None
        q = self._stepped(T_base_tcp, upright)
        return q if q is not None and self._inside(q) else None

    def _stepped(self, T_base_tcp: Pose, seed: Float64Array) -> Float64Array | None:
        T, tcp = geometry.matrix(T_base_tcp), self.arm.T_last_tcp
        found, q = solve_pose(self._T_parents, tcp, T, seed, _POSITION_TOLERANCE_M, _ROTATION_TOLERANCE_RAD)
        return q if found else None

    def _differential(self, T_base_tcp: Pose, near: Float64Array) -> Float64Array | None:
        """A solution within the limits, from the first seed that leads to one."""
        # With a redundant joint, mink's quadratic programmes can keep all joints within their limits.
        solve = _solver(self.arm).solve if len(self.arm.joints) > _POSE_NUMBERS else self._stepped
        for seed in self._seeds(T_base_tcp, near):
            q = solve(T_base_tcp, seed)
            if q is not None and self._inside(q := self._unwound(q, near)):
                return q
        return None

    @cached_property
    def _T_parents(self) -> Float64Array:
        return np.array([joint.T_parent_link for joint in self.arm.joints])

    def _seeds(self, T_base_tcp: Pose, near: Float64Array) -> Iterator[Float64Array]:
        """Joint angles from which to search: the given ones, home, and postures turned towards the tool."""
        home = self.arm.home_q_rad
        if self._down is None:
            yield self._faced(near, T_base_tcp)
            yield near
            yield self._faced(home, T_base_tcp)
            return
        upright = geometry.downward(T_base_tcp.position_m, heading(T_base_tcp))
        below = [self._down.solve(pose, near) for pose in (upright, half_turned(upright))]
        yield from (near, home, *(q for q in below if q is not None))

    def _faced(self, q_rad: Float64Array, T_base_tcp: Pose) -> Float64Array:
        """A posture (J,) [rad] turned about the vertical towards the tool; the last joint is at the tool's heading."""
        T = forward_kinematics.tcp_pose(self.arm, q_rad)
        there, here = (np.arctan2(*pose.position_m[[1, 0]]) for pose in (T_base_tcp, T))
        turn = there - here
        faced = q_rad.copy()
        faced[0] += turn
        # A tool that points down turns against the last joint.
        faced[-1] += heading(T) + turn - heading(T_base_tcp)
        return self._unwound(faced, q_rad)

    def _unwound(self, q_rad: Float64Array, near: Float64Array) -> Float64Array:
        """The same posture (J,) [rad] without whole turns, each joint as near to `near` as its limits allow."""
        best = q_rad + 2.0 * np.pi * np.round((near - q_rad) / (2.0 * np.pi))
        best = np.where(best > self.upper_rad, best - 2.0 * np.pi, best)
        return np.where(best < self.lower_rad, best + 2.0 * np.pi, best)

    def _explain(self, T: Pose, yaw: Yaw) -> str:
        place = ", ".join(f"{value:.3f}" for value in T.position_m)
        posture = "straight down" if points_down(T) else "at that angle"
        way = "" if yaw is Yaw.EITHER else ", turned that way round"
        reach = "" if self.arm.franka is None else _FRANKA_REACH
        return (
            f"the tool cannot be at ({place}) m with the gripper {posture}{way}{reach}; move the target nearer or turn "
            "less"
        )


_FRANKA_REACH = (
    "; straight down over the table it reaches 0.27 to 0.79 m from the base and joint 7 turns by 166° either way"
)


def heading(T: Pose) -> float:
    """Direction of the x axis in the horizontal plane [rad]."""
    w, x, y, z = T.wxyz
    return float(np.arctan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z))


def _nearly_down(T: Pose) -> bool:
    """Whether the tool is turned by half a turn about a nearly horizontal axis."""
    w, _, _, z = T.wxyz
    return bool(2.0 * np.hypot(w, z) < _NEARLY_DOWN_RAD)


def _franka_length_m(arm: ArmModel, sizes: FrankaDimensions) -> float:
    upper, fore = (np.hypot(sizes.elbow_offset_m, length) for length in (sizes.upper_arm_m, sizes.forearm_m))
    return float(upper) + float(fore) + sizes.wrist_offset_m + float(arm.T_last_tcp[2, 3])


class _FrankaPointingDown:
    """The closed solution of an arm of Franka's kind whose gripper points straight down, with q3 = q5 = 0."""

    def __init__(
        self, arm: ArmModel, sizes: FrankaDimensions, lower_rad: Float64Array, upper_rad: Float64Array
    ) -> None:
        self._sizes = sizes
        self._lower_rad, self._upper_rad = lower_rad, upper_rad
        self._hand_m = float(arm.T_last_tcp[2, 3])
        self._upper = float(np.hypot(sizes.elbow_offset_m, sizes.upper_arm_m))
        self._fore = float(np.hypot(sizes.elbow_offset_m, sizes.forearm_m))
        # Angle at the elbow, between shoulder and wrist, that the offsets leave when joint 4 is at zero.
        self._elbow_at_zero = float(
            np.arctan2(sizes.upper_arm_m, sizes.elbow_offset_m) + np.arctan2(sizes.forearm_m, sizes.elbow_offset_m)
        )

    def solve(self, T_base_tcp: Pose, near: Float64Array) -> Float64Array | None:
        """Joint angles (7,) [rad] within the limits, or None."""
        sizes = self._sizes
        x, y, z = T_base_tcp.position_m
        across, up = np.hypot(x, y) - sizes.wrist_offset_m, z + self._hand_m - sizes.shoulder_height_m
        distance_squared = across**2 + up**2
        cosine = (self._upper**2 + self._fore**2 - distance_squared) / (2 * self._upper * self._fore)
        if abs(cosine) > 1.0:
            return None
        bend = 2 * np.pi - self._elbow_at_zero - np.arccos(cosine)
        # Direction from the shoulder to the wrist while joint 2 is at zero, as an angle from the vertical.
        elbow, upper_arm, forearm = sizes.elbow_offset_m, sizes.upper_arm_m, sizes.forearm_m
        forward = elbow - elbow * np.cos(bend) + forearm * np.sin(bend)
        upward = upper_arm + elbow * np.sin(bend) + forearm * np.cos(bend)
        q1, q2 = np.arctan2(y, x), np.arctan2(across, up) - np.arctan2(forward, upward)
        q7 = q1 + np.pi / 4 - heading(T_base_tcp)
        # Whole turns do not change the pose; near the limit the previous angle decides.
        q7 = min((q7 + turn for turn in (-4 * np.pi, -2 * np.pi, 0.0, 2 * np.pi)), key=lambda a: abs(a - near[6]))
        if not self._lower_rad[6] <= q7 <= self._upper_rad[6]:
            q7 = np.arctan2(np.sin(q7), np.cos(q7))
        q = np.array([q1, q2, 0.0, -bend, 0.0, q2 + bend, q7])
        return q if np.all(q >= self._lower_rad) and np.all(q <= self._upper_rad) else None


class _DifferentialSolver:
    """Newton steps on the tool pose by mink, with a weak pull to the seed's posture."""

    def __init__(self, arm: ArmModel) -> None:
        spec = mujoco.MjSpec()
        add_arm(spec, arm, visual=False)
        model = spec.compile()
        self._joints = len(arm.joints)
        self._configuration = mink.Configuration(model)
        self._tool = mink.FrameTask("arm/tcp", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-6)
        self._posture = mink.PostureTask(model, cost=1e-4)
        self._limits = [mink.ConfigurationLimit(model)]

    def solve(self, T_base_tcp: Pose, seed: Float64Array) -> Float64Array | None:
        """Joint angles (J,), or None if the steps do not converge."""
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
                return self._configuration.q[: self._joints].copy()
            try:
                velocity = mink.solve_ik(
                    self._configuration, [self._tool, self._posture], 1.0, solver="daqp", limits=self._limits
                )
            except mink.NoSolutionFound:
                return None
            self._configuration.integrate_inplace(velocity, 1.0)
        return None


@cache
def _solver(arm: ArmModel) -> _DifferentialSolver:
    """The solver of an arm, built once in each process."""
    return _DifferentialSolver(arm)


@njit(cache=True, nogil=True, error_model="numpy")
def solve_pose(
    T_parents: Float64Array,
    T_last_tcp: Float64Array,
    T_base_tcp: Float64Array,
    seed_rad: Float64Array,
    position_m: float,
    rotation_rad: float,
) -> tuple[bool, Float64Array]:
    """Whether Newton's steps from `seed_rad` (J,) [rad] reach a pose (4, 4) within both tolerances; the angles (J,).

    `T_parents` (J, 4, 4) are the links' frames at angle 0, each in its parent's; `T_last_tcp` (4, 4) is the tool's.

    Equivalent to `mink` with one task and no limits, and forty times as fast (18 µs instead of 0.87 ms for the UR5e):
    planning solves thousands of poses. Damped least squares (Nakamura and Hanafusa, "Inverse kinematic solutions with
    singularity robustness for robot manipulator control", ASME JDSMC 108, 1986) with the geometric Jacobian.
    """
    q = seed_rad.copy()
    joints = len(q)
    jacobian, error = np.empty((6, joints)), np.empty(6)
    for _ in range(_NEWTON_STEPS):
        here = np.eye(4)
        for k in range(joints):
            c, s = math.cos(q[k]), math.sin(q[k])
            here = here @ T_parents[k]
            for row in range(3):
                x, y = here[row, 0], here[row, 1]
                here[row, 0], here[row, 1] = c * x + s * y, c * y - s * x
            jacobian[3:, k] = here[:3, 2]
            jacobian[:3, k] = here[:3, 3]
        here = here @ T_last_tcp
        error[:3] = T_base_tcp[:3, 3] - here[:3, 3]
        error[3:] = 0.0
        for axis in range(3):
            error[3:] += 0.5 * np.cross(here[:3, axis], T_base_tcp[:3, axis])
        # Half a turn away from the pose the sum of the cross products vanishes too.
        ahead = here[0, 0] * T_base_tcp[0, 0] + here[1, 0] * T_base_tcp[1, 0] + here[2, 0] * T_base_tcp[2, 0] > 0.0
        if (
            ahead
            and math.sqrt(np.sum(error[:3] ** 2)) < position_m
            and math.sqrt(np.sum(error[3:] ** 2)) < rotation_rad
        ):
            return True, q
        for k in range(joints):
            jacobian[:3, k] = np.cross(jacobian[3:, k], here[:3, 3] - jacobian[:3, k])
        square = jacobian @ jacobian.T
        for row in range(6):
            square[row, row] += _DAMPING
        step = jacobian.T @ np.linalg.solve(square, error)
        q += step * min(1.0, _LARGEST_STEP_RAD / max(np.max(np.abs(step)), 1e-12))
    return False, q
