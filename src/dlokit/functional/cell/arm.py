"""The simulated arm's controller: it sets joint set-points and finger forces, like a real arm's control box."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dlokit import geometry
from dlokit.description.arm.model import Gripper
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import SkillRejected
from dlokit.functional.cell.setpoints import Brake, Fade, Follow, HoldStill, Mirror, Program, Setpoint
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.motion.limits import START_RAD, malformed
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import GripResult, JointTrajectory, RobotMode, RobotReason, RobotState

_REST_SPEED_M_S = 0.002
"""Slower than this, a finger is at rest [m/s]."""
_REST_S = 0.05
"""Time for which it must be slow [s]."""
_BLOCKED_M = 0.0005
"""A finger that rests farther than this from its target is blocked [m]."""
_FIRST_FORCE_N = 20.0
_THINNEST_M = 0.001
"""Smallest thickness that the fingers can detect [m]."""


class Fingers:
    """Both fingers of one hand; a width is the distance between the fingertips."""

    def __init__(self, model: Any, data: Any, *, name: str, gripper: Gripper) -> None:
        """Take control of the fingers of the arm `name`, and open them wide."""
        self._data = data
        joints = [f"{name}/finger_joint{i}" for i in (1, 2)]
        self._qpos: Int64Array = np.array([model.joint(label).qposadr[0] for label in joints], dtype=np.int64)
        self._dofs: Int64Array = np.array([model.joint(label).dofadr[0] for label in joints], dtype=np.int64)
        self._actuators: Int64Array = np.array([model.actuator(f"{name}/finger{i}").id for i in (1, 2)], dtype=np.int64)
        self._stiffness_n_m = float(model.actuator_gainprm[self._actuators[0], 0])
        self._speed_m_s = gripper.finger_speed_m_s
        self._goal_m = self._ramp_m = gripper.open_width_m / 2.0  # of each finger, from the middle
        self._force_n = _FIRST_FORCE_N
        self._slow_s = 0.0
        self._pressing = False
        self._data.qpos[self._qpos] = self._goal_m
        self._data.ctrl[self._actuators] = self._goal_m

    @property
    def width_m(self) -> float:
        """Measured distance between the fingertips."""
        return float(self._data.qpos[self._qpos].sum())

    @property
    def at_rest(self) -> bool:
        """Whether the last grip has ended, at its width or on an object."""
        return self._slow_s >= _REST_S

    @property
    def holding(self) -> bool:
        """Whether the fingers press on an object between them."""
        return self._pressing and self.width_m > max(2 * self._goal_m, 0.0) + _THINNEST_M

    def place(self, width_m: float) -> None:
        """Set the distance between the fingertips, at rest, without a motion."""
        self._data.qpos[self._qpos] = width_m / 2.0
        self._data.qvel[self._dofs] = 0.0

    def start_grip(self, width_m: float, force_n: float) -> None:
        """Move to a width, pressing with at most `force_n` on an object between the fingers."""
        self._goal_m, self._force_n = width_m / 2.0, force_n
        self._ramp_m = self.width_m / 2.0
        self._slow_s, self._pressing = 0.0, False

    def hold(self) -> None:
        """Hold the present width, and keep pressing on a held object."""
        if self._pressing or self.at_rest:
            return
        self._goal_m = self._ramp_m = self.width_m / 2.0
        self._slow_s = _REST_S
        self._data.ctrl[self._actuators] = self._goal_m

    def result(self) -> GripResult:
        """How the grip ended."""
        return GripResult(width_m=self.width_m, held=self.holding)

    def before_step(self, timestep_s: float) -> None:
        """Set the controls for the next physics step."""
        if self._pressing or self.at_rest:
            return
        step = self._speed_m_s * timestep_s
        self._ramp_m += min(max(self._goal_m - self._ramp_m, -step), step)
        measured = self.width_m / 2.0
        reach = self._force_n / self._stiffness_n_m
        command = min(max(self._ramp_m, measured - reach), measured + reach)
        slow = bool(np.abs(self._data.qvel[self._dofs]).max() < _REST_SPEED_M_S)
        arrived = self._ramp_m == self._goal_m
        self._slow_s = self._slow_s + timestep_s if slow and (arrived or command > self._ramp_m) else 0.0
        if self.at_rest and measured > self._goal_m + _BLOCKED_M:
            # An object blocks the fingers: from now on press with the whole force, even if it yields.
            self._pressing = True
            command = measured - reach
        self._data.ctrl[self._actuators] = command


@dataclass(frozen=True, kw_only=True)
class ArmPosture:
    """The pose of an arm at some time."""

    q_rad: Float64Array  # (J,) as its sensors report
    finger_width_m: float


class CellArm:
    """One arm of the cell, controlled every physics step."""

    def __init__(self, model: Any, data: Any, mount: ArmMount, offsets_rad: Float64Array | None = None) -> None:
        """Take control of an arm of a model and put it, at rest, at home by its reported joint angles.

        `offsets_rad` (J,) are reported minus true angles, for an arm whose joints are not calibrated; None: zero
        offsets.
        """
        self.name = name = mount.robot
        self._T_world_base = mount.T_world_base
        self.arm_model = mount.model
        self.limits = self.arm_model.limits
        q_rad = self.arm_model.home_q_rad.copy()
        self.model, self._data = model, data
        labels = [f"{name}/joint{i + 1}" for i in range(len(self.arm_model.joints))]
        self._qpos: Int64Array = np.array([model.joint(label).qposadr[0] for label in labels], dtype=np.int64)
        self._dofs: Int64Array = np.array([model.joint(label).dofadr[0] for label in labels], dtype=np.int64)
        self._actuators: Int64Array = np.array([model.actuator(label).id for label in labels], dtype=np.int64)
        # A position actuator pulls with kp (ctrl - q) - kv dq: adding kv / kp dq makes it follow without lag.
        self._lead_s: Float64Array = (
            -model.actuator_biasprm[self._actuators, 2] / model.actuator_gainprm[self._actuators, 0]
        )
        self._site = int(model.site(f"{name}/tcp").id)
        self.fingers = Fingers(model, data, name=name, gripper=self.arm_model.gripper)
        self._program: Program = HoldStill(q_rad)
        self._unplaced: Mirror | None = None
        self.mode = RobotMode.IDLE
        """The present mode of the arm."""
        self._fault = False
        self.stop_latched = False
        """Whether STOP was pressed and ENABLE was not pressed since."""
        self.largest_error_rad = 0.0
        """Largest difference between commanded and measured joint angles since the last motion began."""
        self._offsets_rad = offsets_rad
        true_rad = q_rad if offsets_rad is None else q_rad - offsets_rad
        data.qpos[self._qpos] = true_rad
        self._data.ctrl[self._actuators] = true_rad

    @property
    def q_rad(self) -> Float64Array:
        """Measured joint angles (J,)."""
        true_rad = np.array(self._data.qpos[self._qpos], dtype=np.float64)
        return true_rad if self._offsets_rad is None else true_rad + self._offsets_rad

    def place(self, posture: ArmPosture) -> None:
        """Set joints and fingers to a pose, at rest, without a motion: to render a past moment."""
        offsets_rad = 0.0 if self._offsets_rad is None else self._offsets_rad
        self._data.qpos[self._qpos] = posture.q_rad - offsets_rad
        self._data.qvel[self._dofs] = 0.0
        self.fingers.place(posture.finger_width_m)

    def setpoint(self, time_s: float) -> Setpoint:
        """The commanded angles at a time."""
        return self._program.at(time_s)

    def begin_mirror(self, start_ns: int) -> Mirror:
        """Follow the states of another arm from now on, which the caller passes to the returned mirror.

        The first state sets the arm's pose directly. `start_ns` is the cell's stamp at its time 0.
        """
        mirror = Mirror(self.arm_model.home_q_rad, start_ns)
        self._program = self._unplaced = mirror
        return mirror

    def start_follow(self, trajectory: JointTrajectory, time_s: float) -> None:
        """Begin a trajectory now.

        Raises `SkillRejected` bad_trajectory for a malformed trajectory, and wrong_start for one that starts elsewhere;
        the planner and the gate before the driver check its limits.
        """
        if wrong := malformed(trajectory, len(self._qpos)):
            raise SkillRejected(RobotReason.BAD_TRAJECTORY, f"{wrong}; plan it again")
        offset_rad = self._program.at(time_s).q_rad - trajectory.q_rad[0]
        off_rad = float(np.abs(offset_rad).max())
        if off_rad > START_RAD:
            raise SkillRejected(
                RobotReason.WRONG_START, f"it starts {off_rad:.3f} rad from where the arm is; plan from its state"
            )
        fade = Fade(offset_rad, self.limits) if np.any(offset_rad) else None
        self._program, self.mode = Follow(trajectory, time_s, fade), RobotMode.MOVING
        self.largest_error_rad = 0.0

    def brake(self, time_s: float, *, fault: bool = False) -> None:
        """Brake within the limits; with `fault` the arm then needs `recover`."""
        self._fault = self._fault or fault
        if self.mode == RobotMode.MOVING:
            self._program = Brake(self._program.at(time_s), self.limits, time_s)
            self.mode = RobotMode.BRAKING
        elif fault and self.mode == RobotMode.IDLE:
            self.mode = RobotMode.FAULT

    def stop(self, time_s: float) -> None:
        """Stop the arm and its fingers until `enable`."""
        self.stop_latched = True
        self.brake(time_s)
        self.fingers.hold()

    def enable(self) -> None:
        """Clear a stop."""
        self.stop_latched = False

    def recover(self) -> None:
        """Clear a fault of an arm at rest."""
        self._fault = False
        if self.mode == RobotMode.FAULT:
            self.mode = RobotMode.IDLE

    def before_step(self, time_s: float) -> None:
        """Set the controls for the physics step that ends at `time_s`."""
        if self.mode in (RobotMode.MOVING, RobotMode.BRAKING) and time_s > self._program.end_s:
            self._finish(time_s)
        if self._unplaced is not None and (first_rad := self._unplaced.first_q_rad) is not None:
            self._data.qpos[self._qpos] = first_rad  # the mirrored arm may be anywhere, and no path leads there
            self._data.qvel[self._dofs] = 0.0
            self._unplaced = None
        now = self._program.at(time_s)
        wanted_rad = now.q_rad if self._offsets_rad is None else now.q_rad - self._offsets_rad
        self._data.ctrl[self._actuators] = wanted_rad + self._lead_s * now.dq_rad_s
        if self.mode == RobotMode.MOVING:
            error = float(np.abs(wanted_rad - self._data.qpos[self._qpos]).max())
            self.largest_error_rad = max(self.largest_error_rad, error)
        self.fingers.before_step(self.model.opt.timestep)

    def state(self, time_s: float, stamp_ns: int) -> RobotState:
        """The readings of the arm's sensors. Kinematics must be up to date."""
        return RobotState(
            stamp_ns=stamp_ns,
            robot=self.name,
            q_rad=self.q_rad,
            dq_rad_s=np.array(self._data.qvel[self._dofs], dtype=np.float64),
            tau_nm=np.array(self._data.actuator_force[self._actuators], dtype=np.float64),
            T_world_tcp=self.reported_tcp(),
            finger_width_m=self.fingers.width_m,
            mode=self.mode,
            holding=self.fingers.holding,
            T_world_base=self._T_world_base,
            stop_latched=self.stop_latched,
        )

    @property
    def T_world_tcp(self) -> Pose:
        """True position of the tool centre point. Kinematics must be up to date."""
        R, place = self._data.site_xmat[self._site].reshape(3, 3), self._data.site_xpos[self._site]
        return geometry.pose_from_matrix(geometry.homogeneous(R, place))

    def reported_tcp(self) -> Pose:
        """Position of the tool centre point that the arm computes from the reported angles."""
        if self._offsets_rad is None:
            return self.T_world_tcp
        T = tcp_pose(self.arm_model, self.q_rad)
        return T if self._T_world_base is None else geometry.compose(self._T_world_base, T)

    def _finish(self, time_s: float) -> None:
        self._program = HoldStill(self._program.at(time_s).q_rad)
        self.mode = RobotMode.FAULT if self._fault else RobotMode.IDLE
