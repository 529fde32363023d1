"""An arm in software: it follows its trajectories exactly, and no hardware moves.

It replaces an arm that must not move, as in a dry run, and an arm in a setup without arm and cell.
"""

from contextlib import AsyncExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import ClassVar, Self

import numpy as np

from dlokit.communication.port import Port
from dlokit.communication.timing.clock import Clock
from dlokit.communication.timing.pulse import Pulse
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import SkillFailure
from dlokit.functional.robots.base import Robot
from dlokit.motion.limits import START_RAD
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import (
    ArmProtection,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotMode,
    RobotReason,
    RobotState,
)

_STEP_S = 0.01
"""Time between two looks whether a motion was braked [s], half a period of the arm's state."""
_BUSY = "busy"  # as a container rejects a second motion


@dataclass(frozen=True, kw_only=True, eq=False)
class _Course:
    """The course of joints and fingers from a time on; a single sample is an arm at rest."""

    began_ns: int
    times_s: Float64Array  # (K,) [s] after it began
    q_rad: Float64Array  # (K, J)
    dq_rad_s: Float64Array  # (K, J)
    widths_m: Float64Array  # (K,)

    @property
    def duration_s(self) -> float:
        """Its duration [s]."""
        return float(self.times_s[-1])

    def at(self, now_ns: int) -> tuple[Float64Array, Float64Array, float]:
        """Angles (J,) [rad], speeds (J,) [rad/s] and width [m] at a time; the last ones after its end."""
        t_s = (now_ns - self.began_ns) / 1e9
        q, dq = (
            np.array([np.interp(t_s, self.times_s, joint) for joint in samples.T])
            for samples in (self.q_rad, self.dq_rad_s)
        )
        return q, dq, float(np.interp(t_s, self.times_s, self.widths_m))


class KinematicRobot:
    """An arm without mass: it brakes at once, and its fingers close on nothing.

    With a `device`, it begins at the pose of that arm, and passes a person's stop and enable on to it; the device gets
    no motion, no grip, and no other order.
    """

    def __init__(
        self, clock: Clock, mount: ArmMount, device: Robot | None = None, standing: RobotState | None = None
    ) -> None:
        """`clock` stamps its states; it begins in the state `standing`, by default at home."""
        from dlokit.motion.inverse_kinematics import ArmKinematics  # here: every process loads the settings below

        self._clock = clock
        self._mount = mount
        self._kinematics = ArmKinematics(mount.model, mount.T_world_base)
        self._device = device
        self._opened = AsyncExitStack()
        home = (mount.model.home_q_rad, mount.model.gripper.open_width_m)
        self._course = self._resting(0, *(home if standing is None else (standing.q_rad, standing.finger_width_m)))
        self._braked: _Course | None = None
        self._latched = standing is not None and standing.stop_latched
        self._newest_ns = 0

    @property
    def arm(self) -> ArmModel:
        """The arm as it is mounted."""
        return self._mount.model

    async def __aenter__(self) -> Self:
        """Connect to the device, if there is one. Raises `HardwareError` when it does not answer."""
        if self._device is not None:
            await self._opened.enter_async_context(self._device)
            state = self._device.state()
            self._latched = state.stop_latched
            self._course = self._resting(self._clock.now_ns(), state.q_rad, state.finger_width_m)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect from the device."""
        self._rest()
        await self._opened.aclose()

    def state(self) -> RobotState:
        """The state now, always fresh. Raises `HardwareError` when the device is gone."""
        if self._braked is self._course:
            self._rest()
        now_ns = self._newest_ns = self._clock.now_ns()
        q_rad, dq_rad_s, width_m = self._course.at(now_ns)
        return RobotState(
            stamp_ns=now_ns,
            robot=self._mount.robot,
            q_rad=q_rad,
            dq_rad_s=dq_rad_s,
            tau_nm=np.zeros(len(q_rad)),
            T_world_tcp=self._kinematics.forward(q_rad),
            finger_width_m=width_m,
            mode=RobotMode.MOVING if self._is_moving else RobotMode.IDLE,
            T_world_base=self._mount.T_world_base,
            stop_latched=self._latched or (self._device is not None and self._device.state().stop_latched),
        )

    def now_ns(self) -> int:
        """Time of the newest state: software has no late feedback."""
        return self._newest_ns

    def newest_ns(self) -> int:
        """Time of the newest state."""
        return self._newest_ns

    def protection(self) -> ArmProtection | None:
        """The protection settings of the arm that a dry run reads; None without one."""
        return None if self._device is None else self._device.protection()

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory in software; there is no controller that could miss a heartbeat of the `lease`."""
        self._check_idle()
        q_rad, _, width_m = self._course.at(self._clock.now_ns())
        off_rad = float(np.abs(trajectory.q_rad[0] - q_rad).max())
        if off_rad > START_RAD:
            raise SkillFailure(
                RobotReason.WRONG_START, f"it starts {off_rad:.3f} rad from where the arm is; plan from there"
            )
        course = _Course(
            began_ns=self._clock.now_ns(),
            times_s=trajectory.times_s,
            q_rad=trajectory.q_rad,
            dq_rad_s=trajectory.dq_rad_s,
            widths_m=np.full(len(trajectory.times_s), width_m),
        )
        await self._run(course)
        end = self.state()
        return MotionResult(
            q_rad=end.q_rad, T_world_tcp=end.T_world_tcp, duration_s=course.duration_s, largest_joint_error_rad=0.0
        )

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Bring the fingers to a width, in software: nothing is between them."""
        self._check_idle()
        q_rad, _, before_m = self._course.at(self._clock.now_ns())
        duration_s = abs(width_m - before_m) / (2.0 * self.arm.gripper.finger_speed_m_s)
        course = _Course(
            began_ns=self._clock.now_ns(),
            times_s=np.array([0.0, max(duration_s, _STEP_S)]),
            q_rad=np.stack([q_rad, q_rad]),
            dq_rad_s=np.zeros((2, len(q_rad))),
            widths_m=np.array([before_m, width_m]),
        )
        await self._run(course)
        return GripResult(width_m=width_m, held=False)

    async def halt(self) -> None:
        """Brake at once."""
        self._rest()

    async def stop(self) -> None:
        """Brake at once and latch; the device is stopped as well."""
        self._latched = True
        self._rest()
        if self._device is not None:
            await self._device.stop()

    async def enable(self) -> None:
        """Clear a stop, also the device's."""
        if self._device is not None:
            await self._device.enable()
        self._latched = False

    def brake(self) -> None:
        """Order it to brake; from any thread."""
        self._braked = self._course

    async def recover(self) -> None:
        """Do nothing: it has no faults, and the device's faults stay."""

    async def _run(self, course: _Course) -> None:
        """Run a course to its end. Raises `SkillFailure` if the arm was braked before its end."""
        self._course = course
        try:
            end_ns = course.began_ns + round(course.duration_s * 1e9)
            while self._course is course and self._braked is not course and self._clock.now_ns() < end_ns:
                await self._clock.sleep(_STEP_S)
            if self._course is not course or self._braked is course:
                raise SkillFailure(RobotReason.STOPPED, "the arm braked before the end of the motion")
        finally:
            if self._course is course:
                self._rest()

    def _rest(self) -> None:
        """Stay at the present angles and width."""
        now_ns = self._clock.now_ns()
        q_rad, _, width_m = self._course.at(now_ns)
        self._course = self._resting(now_ns, q_rad, width_m)

    @staticmethod
    def _resting(now_ns: int, q_rad: Float64Array, width_m: float) -> _Course:
        q = np.array(q_rad, dtype=np.float64)[None]
        return _Course(
            began_ns=now_ns, times_s=np.zeros(1), q_rad=q, dq_rad_s=np.zeros_like(q), widths_m=np.array([width_m])
        )

    @property
    def _is_moving(self) -> bool:
        return len(self._course.times_s) > 1

    def _check_idle(self) -> None:
        if self._latched:
            raise SkillFailure(
                RobotReason.STOP_LATCHED, "a person has stopped the arm; a person must enable it: dlokit enable"
            )
        if self._is_moving:
            raise SkillFailure(_BUSY, "the arm is moving; wait, or call stop")


@dataclass(frozen=True, kw_only=True)
class KinematicRobotConfig:
    """An arm in software that starts at home: no hardware moves, and it never grasps an object."""

    name: ClassVar[str] = "kinematic"
    in_cell: ClassVar[bool] = False
    is_real: ClassVar[bool] = False

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        """The driver."""
        return KinematicRobot(port.clock, mount)
