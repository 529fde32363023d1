"""The driver of the Franka Research 3 and of the Panda, with Franka's hand. It runs in dlokit's robot process.

The driver plans nothing and commands nothing itself: it posts trajectories and orders to the streaming process and the
hand process, and reads the states that they publish. See ``docs/decisions/0024-franka.md``.
"""

import asyncio
import fcntl
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

import numpy as np
from msgspec import Meta

from dlokit import geometry
from dlokit.communication.port import Port
from dlokit.communication.timing.pulse import Pulse
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import ConfigError, HardwareError, SkillFailure, install_command
from dlokit.extras.franka.channel import (
    Channel,
    ChannelError,
    GripKind,
    HandState,
    Latch,
    MotionEnding,
    Samples,
    StreamPhase,
    StreamState,
    Word,
    path_of,
    read_urdf,
)
from dlokit.extras.franka.hand import EMPTY_M, HOMED, judged
from dlokit.extras.franka.limits import below_speed_limits, beyond_limits
from dlokit.extras.franka.link import Protection
from dlokit.extras.franka.panda_link import ARM as PANDA
from dlokit.extras.franka.panda_link import MARGIN_RAD
from dlokit.extras.franka.processes import DeviceProcesses, is_alive, kill_stray
from dlokit.extras.franka.reflexes import ArmMode, Reaction, named, reaction
from dlokit.extras.franka.tool_check import flange_tool, mismatch
from dlokit.functional.robots.base import Robot
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.motion.limits import AT_REST_RAD_S, START_RAD
from dlokit.ranges import check_ranges
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

if TYPE_CHECKING:
    from dlokit.app.doctor.machine import DoctorRow

log = logging.getLogger(__name__)

_POLL_S = 0.004
"""Time between two looks at the shared memory [s]; the streaming process publishes every 3 ms."""
_CONNECT_S = 15.0
_STRAY_S = 3.0
"""Longest wait for the processes of a dead driver [s]; their guardian ends them after 2 s."""
_STOP_S = 2.0
"""Longest wait until the arm is at rest after an order [s]; on a quiet machine it takes 0.2."""
_RECOVER_S = 5.0
_CLOSE_S = 2.0
_ARMS = ("fr3", PANDA)
_BUSY = "busy"  # as a container rejects a second motion

_LATCHED: dict[int, tuple[RobotReason, str]] = {
    Latch.PERSON: (RobotReason.STOPPED, "a person has stopped the arm"),
    Latch.COLLISION: (RobotReason.COLLISION, "the arm has felt a collision"),
    Latch.USER_STOP: (RobotReason.USER_STOP, "the arm's own stop button or enabling device is pressed"),
    Latch.GUIDING: (RobotReason.USER_STOP, "a person guides the arm by hand"),
    Latch.ARM_ERROR: (RobotReason.FAULT, "the arm reports an error that a person must see to"),
}
_MODES = {
    StreamPhase.IDLE: RobotMode.IDLE,
    StreamPhase.MOVING: RobotMode.MOVING,
    StreamPhase.BRAKING: RobotMode.BRAKING,
    StreamPhase.HOLDING: RobotMode.MOVING,
}


class FrankaRobot:
    """An FR3 or a Panda, and its hand."""

    def __init__(self, config: "FrankaRobotConfig", mount: ArmMount, pulse: Pulse, folder: Path | None = None) -> None:
        """`folder` holds the shared memory; None: the machine's usual one."""
        self._config, self._mount, self._pulse = config, mount, pulse
        self._path = path_of(config.address) if folder is None else path_of(config.address, folder)
        tool = flange_tool(mount.model)
        x, y, z = (float(value) for value in tool[:3, 3])
        self._protection = Protection(
            torque_nm=config.collision_torque_nm,
            force_n=config.collision_force_n,
            load_kg=config.load_kg,
            load_at_m=(x, y, z),
        )
        self._channel: Channel | None = None
        self._processes: DeviceProcesses | None = None
        self._state: RobotState | None = None
        self._hand: HandState | None = None
        self._set: ArmProtection | None = None
        self._busy = self._held = False

    @property
    def arm(self) -> ArmModel:
        """The arm as it is mounted."""
        return self._mount.model

    @property
    def pids(self) -> dict[str, int]:
        """Ids of the arm's processes: guardian, stream, hand."""
        return {} if self._processes is None else self._processes.pids()

    def protection(self) -> ArmProtection | None:
        """Thresholds and load as set on the last connection or recovery, with the tool and load read back."""
        return self._set

    def read_back(self) -> str:
        """The mode, tool and load in the arm's newest state; empty before its first state."""
        state = self._shared.read_state()
        if state is None:
            return ""
        x, y, z = 1e3 * np.reshape(state.T_flange_tool, (4, 4))[:3, 3]
        return (
            f"mode {ArmMode(state.mode).name.lower()}, tool of {state.tool_kg:.3f} kg at ({x:.1f}, {y:.1f}, {z:.1f}) "
            f"mm from the flange, load of {state.load_kg:.3f} kg"
        )

    async def __aenter__(self) -> Self:
        """Connect. Raises `HardwareError`, which names the missing requirement."""
        try:
            self._channel = Channel(self._path)
            fcntl.flock(self._channel.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ChannelError as error:
            raise HardwareError(str(error)) from error
        except BlockingIOError:
            self._close_channel()
            raise HardwareError(
                f"another process of this computer drives the arm {self._config.address}; end it first"
            ) from None
        try:
            await self._end_stray()
            await self._connect()
        except BaseException:
            self._close_channel()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Brake, wait until the arm is at rest, and end the processes; a latched stop stays."""
        self.brake()
        await becomes(lambda: self._lost() != "" or not self._in_motion(), _STOP_S)
        await self._disconnect()
        self._close_channel()

    def _close_channel(self) -> None:
        if self._channel is not None:
            self._channel.close()
            self._channel = None

    @property
    def _shared(self) -> Channel:
        if self._channel is None:
            raise HardwareError("the arm is not connected; enter the driver first")
        return self._channel

    async def _end_stray(self) -> None:
        """Wait until the streaming process of a dead driver has braked and ended."""
        pid = self._shared[Word.STREAM_PID]
        if pid and not await becomes(lambda: not is_alive(pid), _STRAY_S):
            kill_stray(pid)

    async def _connect(self) -> None:
        channel = self._shared
        channel.write_text("")
        channel[Word.BRAKE_ID], channel[Word.HOLD_ID] = channel[Word.FOLLOW_ID], channel[Word.GRIP_ID]
        channel[Word.RECOVERED_ID] = channel[Word.RECOVER_ID]
        began_ns = time.monotonic_ns()
        self._processes = DeviceProcesses(channel, self._path)
        self._processes.start(self._config.address, self._protection, self.arm, self._config.real_time)

        def answered() -> bool:
            state, hand = channel.read_state(), channel.read_hand()
            return state is not None and hand is not None and min(state.read_ns, hand.read_ns) > began_ns

        await becomes(lambda: answered() or self._lost() != "", _CONNECT_S)
        wrong = self._lost() or ("" if answered() else f"no state came within {_CONNECT_S:g} s") or self._differs()
        if wrong:
            await self._disconnect()
            raise HardwareError(f"the arm at {self._config.address} cannot be used: {wrong}")
        self._note_protection(recovered=False)

    async def _disconnect(self) -> None:
        if self._processes is not None:
            await asyncio.to_thread(self._processes.end, _CLOSE_S)
            self._processes = None

    def _differs(self) -> str:
        state = self._shared.read_state()
        if state is None:
            return ""
        return mismatch(self.arm, state, self._config.load_kg) or beyond_limits(self.arm, read_urdf(self._path))

    def _lost(self) -> str:
        if self._processes is None:
            return "the arm is not connected; call robot.recover"
        return self._processes.lost(time.monotonic_ns())

    def state(self) -> RobotState:
        """The newest state; the last one after the connection was lost."""
        channel = self._shared
        stream, hand = channel.read_state(), channel.read_hand() or self._hand
        latched = channel[Word.LATCH] != Latch.NONE
        if stream is None or hand is None:
            if self._state is None:
                raise HardwareError("no state of the arm has arrived yet")
            return self._state
        self._hand = hand
        mode = RobotMode.FAULT if self._lost() else _MODES.get(StreamPhase(stream.phase), RobotMode.FAULT)
        q_rad = np.array(stream.q)
        tool = tcp_pose(self.arm, q_rad)
        wrench = np.array(stream.wrench)
        base = self._mount.T_world_base
        if base is not None:
            tool = geometry.compose(base, tool)
            wrench = (geometry.rotation(base) @ wrench.reshape(2, 3).T).T.ravel()
        self._state = RobotState(
            stamp_ns=stream.read_ns,
            robot=self._mount.robot,
            q_rad=q_rad,
            dq_rad_s=np.array(stream.dq),
            tau_nm=np.array(stream.tau),
            T_world_tcp=tool,
            finger_width_m=float(np.clip(hand.width_m, 0.0, self.arm.gripper.open_width_m)),
            mode=mode,
            wrench_world=wrench,
            holding=self._held and not hand.running and hand.width_m > EMPTY_M,
            T_world_base=base,
            stop_latched=latched,
        )
        return self._state

    def now_ns(self) -> int:
        """The machine's monotonic clock, on which states are stamped when they arrive."""
        return time.monotonic_ns()

    def newest_ns(self) -> int:
        """Stamp of the newest state in the shared memory; it ages when the arm's clock does not advance."""
        return self._shared[Word.STATE_NS]

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory, slowed down if a joint would be too near its speed limit; cancelling brakes the arm."""
        self._check_ready()
        channel = self._shared
        off_rad = float(np.abs(trajectory.q_rad[0] - self.state().q_rad).max())
        if not off_rad <= START_RAD:  # the difference fades out in the motion
            raise SkillFailure(
                RobotReason.WRONG_START, f"it starts {off_rad:.3f} rad from where the arm is; plan from there"
            )
        self._check_margin(trajectory)
        trajectory = below_speed_limits(trajectory, self.arm)
        times, q, dq = (
            np.ascontiguousarray(each) for each in (trajectory.times_s, trajectory.q_rad, trajectory.dq_rad_s)
        )
        motion_id = channel[Word.FOLLOW_ID] + 1
        self._busy = True
        try:
            self._begin_lease(lease)
            try:
                channel.post(Samples(times=times.tobytes(), q=q.tobytes(), dq=dq.tobytes()), motion_id)
            except ChannelError as error:
                raise SkillFailure(RobotReason.TOO_SLOW, str(error)) from error
            async with self._pulse(self._beat, lease.heartbeat_s):
                ended = await self._ended(motion_id)
        except asyncio.CancelledError:
            self.brake()
            raise
        finally:
            self._busy = False
        if ended.ending != MotionEnding.ARRIVED:
            raise self._failure(ended)
        state = self.state()
        return MotionResult(
            q_rad=state.q_rad,
            T_world_tcp=state.T_world_tcp,
            duration_s=ended.took_s,
            largest_joint_error_rad=ended.largest_error_rad,
        )

    def _check_margin(self, trajectory: JointTrajectory) -> None:
        """Refuse targets near the end of a joint's range, which a Panda's library does not accept."""
        if self.arm.name != PANDA:
            return
        lower, upper = self.arm.limits.position_lower_rad, self.arm.limits.position_upper_rad
        left_rad = np.minimum(trajectory.q_rad - lower, upper - trajectory.q_rad).min(axis=0)
        joint = int(np.argmin(left_rad))
        if left_rad[joint] < MARGIN_RAD:
            raise SkillFailure(
                RobotReason.JOINT_LIMIT,
                f"joint {joint + 1} would come within {left_rad[joint]:.3f} rad of its end, and franka-rs needs "
                f"{MARGIN_RAD}; choose another target",
            )

    async def _ended(self, motion_id: int) -> StreamState:
        while True:
            state = self._shared.read_state()
            if state is not None and state.motion_id == motion_id and state.ending != MotionEnding.NONE:
                return state
            self._check_connected()
            await asyncio.sleep(_POLL_S)

    def _failure(self, ended: StreamState) -> SkillFailure:
        """Why a motion did not arrive."""
        latch = self._shared[Word.LATCH]
        errors = ", ".join(named(ended.errors)) or f"mode {ArmMode(ended.mode).name.lower()}"
        if latch:
            reason, why = _LATCHED[latch]
            return SkillFailure(reason, why if latch == Latch.PERSON else f"{why} ({errors}); enable it after a look")
        match ended.ending:
            case MotionEnding.BRAKED:
                return SkillFailure(RobotReason.STOPPED, "the arm braked at an order before the end of the motion")
            case MotionEnding.LEASE:
                return SkillFailure(RobotReason.LOST_COMMANDER, "no heartbeat of the driver came in time")
            case MotionEnding.TRACKING:
                return SkillFailure(
                    RobotReason.TRACKING,
                    f"a joint was {ended.largest_error_rad:.3f} rad from its set-point, and the arm braked: it pushes "
                    "against something, or this machine is too busy",
                )
            case MotionEnding.ARM if reaction(ended.errors) is Reaction.RECOVER:
                return SkillFailure(
                    RobotReason.REFLEX, f"the arm stopped itself because set-points came late or jumped: {errors}"
                )
            case MotionEnding.ARM | MotionEnding.REFUSED:
                return SkillFailure(RobotReason.FAULT, f"the arm does not move: {errors}; call robot.recover")
            case _:
                return SkillFailure(
                    RobotReason.ROBOT_LOST, "guardian or shared memory of the arm fail; call robot.recover"
                )

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Move the fingers to a width; home them first if the hand was switched on since the last homing."""
        self._check_ready()
        self._busy, self._held = True, False
        try:
            self._begin_lease(lease)
            async with self._pulse(self._beat, lease.heartbeat_s):
                hand = self._shared.read_hand()
                if hand is not None and hand.largest_width_m < HOMED * self.arm.gripper.open_width_m:
                    await self._gripped(GripKind.HOME, 0.0, force_n)
                kind = GripKind.GRASP if width_m <= EMPTY_M else GripKind.MOVE
                hand = await self._gripped(kind, width_m, force_n)
        except asyncio.CancelledError:
            self._shared[Word.HOLD_ID] = self._shared[Word.GRIP_ID]
            raise
        finally:
            self._busy = False
        verdict = judged(width_m, hand.before_m, hand.width_m)
        if verdict.jammed:
            raise SkillFailure(
                RobotReason.GRIPPER_JAMMED,
                f"the fingers stopped at {1e3 * hand.width_m:.1f} mm on the way to {1e3 * width_m:.1f} mm; free them",
            )
        self._held = verdict.held
        return GripResult(width_m=max(hand.width_m, 0.0), held=verdict.held)

    async def _gripped(self, kind: GripKind, width_m: float, force_n: float) -> HandState:
        channel = self._shared
        grip_id = channel[Word.GRIP_ID] + 1
        channel[Word.GRIP_KIND] = kind
        channel[Word.GRIP_WIDTH_UM], channel[Word.GRIP_FORCE_MN] = round(1e6 * width_m), round(1e3 * force_n)
        channel[Word.GRIP_ID] = grip_id
        while True:
            hand = channel.read_hand()
            if hand is not None and hand.grip_id == grip_id and not hand.running:
                break
            self._check_connected()
            await asyncio.sleep(_POLL_S)
        if hand.cancelled:
            ordered = channel[Word.HOLD_ID] >= grip_id or channel[Word.LATCH]
            if ordered:
                raise SkillFailure(RobotReason.STOPPED, "the fingers were stopped on their way")
            raise SkillFailure(RobotReason.LOST_COMMANDER, "no heartbeat of the driver came in time; the fingers hold")
        return hand

    async def halt(self) -> None:
        """Brake on the path."""
        self.brake()
        if not await becomes(lambda: self._lost() != "" or not self._in_motion(), _STOP_S):
            raise SkillFailure(RobotReason.NOT_CONFIRMED, f"the arm still moves {_STOP_S:g} s after the order to brake")
        self._check_connected()

    async def stop(self) -> None:
        """Brake, hold the fingers, and latch; the latch outlives this process."""
        channel = self._shared
        channel[Word.LATCH] = channel[Word.LATCH] or Latch.PERSON
        await self.halt()

    async def enable(self) -> None:
        """Clear a stop, and the errors that led to it."""
        channel = self._shared
        if self._lost():
            await self._connect_again()
        else:
            await self._clear_errors()
        channel[Word.LATCH] = Latch.NONE

    def brake(self) -> None:
        """Order the arm to brake and the fingers to hold; from any thread."""
        channel = self._channel
        if channel is not None:
            channel[Word.BRAKE_ID] = channel[Word.FOLLOW_ID]
            channel[Word.HOLD_ID] = channel[Word.GRIP_ID]

    async def recover(self) -> None:
        """Connect again if the connection was lost, and clear errors that do not need a person."""
        if self._lost():
            await self._connect_again()
            return
        state = self._shared.read_state()
        if state is not None and state.phase == StreamPhase.FAULT and not self._shared[Word.LATCH]:
            await self._clear_errors()

    async def _connect_again(self) -> None:
        await self._disconnect()
        try:
            await self._connect()
        except HardwareError as error:
            raise SkillFailure(RobotReason.ROBOT_LOST, str(error)) from error

    async def _clear_errors(self) -> None:
        channel = self._shared
        asked, began_ns = channel[Word.RECOVER_ID] + 1, time.monotonic_ns()
        channel[Word.RECOVER_ID] = asked

        def answered() -> bool:
            return channel[Word.RECOVERED_ID] == asked and channel[Word.STATE_NS] > began_ns

        await becomes(lambda: answered() or self._lost() != "", _RECOVER_S)
        self._check_connected()
        state = channel.read_state()
        if not answered() or state is None or state.mode != ArmMode.IDLE:
            mode = "unknown" if state is None else ArmMode(state.mode).name.lower()
            raise SkillFailure(
                RobotReason.NOT_CONFIRMED,
                f"the arm is in mode {mode} and not ready to move: release its stop button, end guiding, or clear the "
                "error in Desk, then enable it again",
            )
        wrong = self._differs()
        if wrong:
            raise SkillFailure(RobotReason.FAULT, wrong)
        self._note_protection(recovered=True)

    def _note_protection(self, *, recovered: bool) -> None:
        """Store the settings and the values read back, for the recording, and log them."""
        state, wanted = self._shared.read_state(), self._protection
        if state is None:  # its writer has just frozen: the next call fails as robot_lost
            return
        self._set = ArmProtection(
            stamp_ns=state.read_ns,
            robot=self._mount.robot,
            recovered=recovered,
            torque_nm=wanted.torque_nm,
            force_n=wanted.force_n,
            load_kg=wanted.load_kg,
            load_at_m=np.array(wanted.load_at_m),
            reported_load_kg=state.load_kg,
            reported_tool_kg=state.tool_kg,
            T_flange_tool=geometry.pose_from_matrix(np.reshape(state.T_flange_tool, (4, 4))),
        )
        when = "recovered" if recovered else "connected to"
        log.info("%s %s with %s; read back: %s", when, self._config.address, wanted, self.read_back())

    def _begin_lease(self, lease: Lease) -> None:
        self._beat()
        self._shared[Word.LEASE_NS] = round(lease.duration_s * 1e9)

    def _beat(self) -> None:
        self._shared[Word.DRIVER_BEAT_NS] = time.monotonic_ns()

    def _in_motion(self) -> bool:
        state, hand = self._shared.read_state(), self._shared.read_hand()
        moving = state is not None and (
            state.phase in (StreamPhase.MOVING, StreamPhase.BRAKING)
            or (state.phase == StreamPhase.HOLDING and max(map(abs, state.dq)) > AT_REST_RAD_S)
        )
        # The fingers have the order to hold; their rest is detected later.
        return moving or (hand is not None and bool(hand.running) and not hand.cancelled)

    def _check_ready(self) -> None:
        latch = self._shared[Word.LATCH]
        if latch:
            why = _LATCHED[latch][1]
            raise SkillFailure(RobotReason.STOP_LATCHED, f"{why}; a person must enable it: dlokit enable")
        if self._busy:
            raise SkillFailure(_BUSY, "the arm is moving; wait, or call stop")
        self._check_connected()

    def _check_connected(self) -> None:
        lost = self._lost()
        if lost:
            raise SkillFailure(RobotReason.ROBOT_LOST, f"{lost}; then call robot.recover")


async def becomes(is_so: Callable[[], bool], limit_s: float) -> bool:
    """Wait until a condition holds; returns whether it does within this time on the machine's clock."""
    now_s = asyncio.get_running_loop().time
    deadline_s = now_s() + limit_s
    while not is_so():
        if now_s() > deadline_s:
            return False
        await asyncio.sleep(_POLL_S)
    return True


@dataclass(frozen=True, kw_only=True)
class FrankaRobotConfig:
    """A Franka Research 3 with Franka's hand (extra `franka`), or a Panda, untested (extra `panda`)."""

    name: ClassVar[str] = "franka"
    in_cell: ClassVar[bool] = False
    is_real: ClassVar[bool] = True

    address: str = "172.16.0.2"
    """Network address of the arm's controller."""
    real_time: bool = True
    """Refuse a computer without a real-time kernel. False: for simulators of the arm only."""
    collision_torque_nm: Annotated[float, Meta(ge=5.0, le=40.0)] = 20.0
    """External torque of any joint at which the arm stops itself [N·m]. Larger: fewer stops, harder contacts."""
    collision_force_n: Annotated[float, Meta(ge=5.0, le=60.0)] = 30.0
    """External force on the tool at which the arm stops itself [N]. Larger: fewer stops, harder contacts."""
    load_kg: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    """Mass of equipment fixed to the hand, such as a camera [kg]; its centre is assumed between the fingertips."""

    def __post_init__(self) -> None:
        check_ranges(self, "driver")

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        """The driver."""
        if mount.model.name not in _ARMS:
            raise ConfigError(
                f"--driver franka moves a Franka Research 3 or a Panda, and the arm is --arm {mount.model.name}: add "
                "--arm fr3 or --arm panda."
            )
        if mount.model.name == PANDA and self.load_kg:
            raise ConfigError(
                "--driver.load-kg cannot be set on a Panda, because franka-rs has no call for it: leave it at 0, and "
                "add what the hand carries to the end effector in Desk."
            )
        if mount.instance:
            raise ConfigError("--driver franka has one address and moves one arm: leave --arms at 1.")
        return FrankaRobot(self, mount, pulse)

    @classmethod
    def findings(cls) -> "tuple[DoctorRow, ...]":
        """The rows of `dlokit doctor` for the packages of both arms."""
        from dlokit.app.doctor.machine import device_package_finding

        return (
            device_package_finding("franky-control", "franky", "the FR3 arm", install_command("franka")),
            device_package_finding("franka-rs", "franka", "the Panda arm", install_command("panda")),
        )
