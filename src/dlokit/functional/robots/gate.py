"""The last check before any driver: it refuses invalid motions, no matter which component planned them."""

import asyncio
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Annotated, Self

import numpy as np
import tyro
from msgspec import Meta

from dlokit import geometry
from dlokit.communication.timing.deadlines import DeadlineWatchdog, LoopWatchdog
from dlokit.description.arm.mounts import WORKSPACE, WorkspaceBox
from dlokit.errors import SkillFailure
from dlokit.functional.robots.base import Robot
from dlokit.motion.forward_kinematics import tcp_matrices
from dlokit.motion.limits import AT_REST_RAD_S, START_RAD, check_limits, scaled
from dlokit.ranges import Positive, check_ranges
from dlokit.types.pose import Pose
from dlokit.types.robot import (
    ArmProtection,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotReason,
    RobotState,
)

SLOWEST_SCALE = 0.05
"""Smallest `speed_scale`: below it a motion takes longer than a skill waits."""


@dataclass(frozen=True, kw_only=True)
class GateConfig:
    """Limits that every motion must meet before it reaches an arm, no matter which skill requests it."""

    largest_tool_speed_m_s: Positive = 2.5
    """Largest speed of the tool centre point [m/s]; joint motions over the table reach 1.9."""
    speed_scale: Annotated[float, Meta(ge=SLOWEST_SCALE, le=1.0), tyro.conf.arg(aliases=("--speed-scale",))] = 1.0
    """Factor on the speed of every motion, 0.05 to 1; accelerations change with its square. 0.1 to try things out."""

    def __post_init__(self) -> None:
        check_ranges(self, "gate")


FEEDBACK_AGE_S = 0.1
"""Largest age of the arm's feedback [s], five periods of its state. A motion begins only after newer feedback has
arrived, by the machine's clock; during a motion, the age counts on the arm's own clock, which pauses while a simulated
cell renders a picture (decision 17)."""
_LONGEST_WAIT_S = 1.0
"""Longest wait for new feedback [s of the gate's clock]: a cell that renders a picture publishes nothing for 0.3 s."""
_LOOK_S = 0.01
"""Time between two looks for new feedback [s], half a period of the arm's state."""


class GatedRobot:
    """A robot whose motions pass the gate first; all other methods are the driver's own."""

    def __init__(
        self,
        robot: Robot,
        config: GateConfig,
        now_ns: Callable[[], int],
        *,
        T_world_base: Pose | None = None,
        workspace: WorkspaceBox = WORKSPACE,
        may_move: Callable[[str], bool] = bool,
        watch: DeadlineWatchdog | None = None,
    ) -> None:
        """`now_ns` is the machine's clock, by which feedback ages before a motion; virtual time in lockstep.

        `may_move` returns whether a holder of that name may move now; by default any holder with a name may. `watch`
        checks that feedback stays fresh while the arm moves, by default on the event loop.
        """
        self._robot = robot
        self.arm = robot.arm
        """The driver's arm."""
        self._config = config
        self._now_ns = now_ns
        self._T_world_base = T_world_base
        self._workspace = workspace
        self._may_move = may_move
        self._feedback = _Feedback()
        self._watch = watch or LoopWatchdog()

    async def __aenter__(self) -> Self:
        """Connect. Raises `HardwareError` when the arm does not answer."""
        self._feedback.begin(self._now_ns())
        await self._robot.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the arm at rest and disconnect."""
        await self._robot.__aexit__(kind, error, trace)

    def state(self) -> RobotState:
        """The driver's newest state."""
        state = self._robot.state()
        self._feedback.age_s(state.stamp_ns, self._now_ns())
        return state

    def now_ns(self) -> int:
        """The driver's clock."""
        return self._robot.now_ns()

    def newest_ns(self) -> int:
        """Stamp of the driver's newest feedback."""
        return self._robot.newest_ns()

    def protection(self) -> ArmProtection | None:
        """The driver's protection settings."""
        return self._robot.protection()

    async def standing(self) -> RobotState:
        """A fresh state of the arm at rest; waits while feedback is too old, or the arm still moves.

        Raises `SkillFailure` stale_feedback or wrong_start after 1 s.
        """
        began_ns = self._now_ns()
        while True:
            state = self._robot.state()
            age_s = self._feedback.age_s(state.stamp_ns, self._now_ns())
            # Since feedback of some age an arm may have slowed down by its acceleration limit.
            still = np.abs(state.dq_rad_s) <= AT_REST_RAD_S + age_s * self.arm.limits.acceleration_rad_s2
            if age_s <= FEEDBACK_AGE_S and still.all():
                return state
            waited_s = (self._now_ns() - began_ns) / 1e9
            if waited_s > _LONGEST_WAIT_S:
                raise _not_standing(state, age_s, waited_s)
            await asyncio.sleep(_LOOK_S)

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory at the pace of `speed_scale` if it passes; brake if feedback fails during the motion.

        Raises `SkillFailure` joint_limit, velocity_limit, acceleration_limit, jerk_limit, bad_trajectory, too_slow,
        outside_workspace, tool_speed, stale_feedback, wrong_start or lease_lost before the driver is called, and
        stale_feedback after the arm was braked during the motion.
        """
        paced = scaled(trajectory, self._config.speed_scale)
        check_limits(paced, self.arm.limits)
        self._check_tool(paced)
        state = await self.standing()
        off_rad = float(np.abs(paced.q_rad[0] - state.q_rad).max())
        if not off_rad <= START_RAD:  # NaN too
            raise SkillFailure(
                RobotReason.WRONG_START,
                f"it starts {off_rad:.3f} rad from the measured angles, allowed are {START_RAD} rad; plan from "
                "the present state",
            )
        self._check_lease(lease)
        fresh = _FreshFeedback(self._robot)
        self._watch.begin(fresh, fresh.brake)
        try:
            result = await self._robot.follow(paced, lease)
        except SkillFailure as error:
            if fresh.lost:
                raise _stale() from error
            raise
        finally:
            self._watch.end(fresh)
        if fresh.lost:  # the arm may have arrived before the order to brake
            raise _stale()
        return result

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Move the fingers to a width.

        Raises `SkillFailure` bad_width or bad_force beyond the hand's limits, and lease_lost.
        """
        refused = self.arm.gripper.refusal(width_m, force_n)
        if refused is not None:
            raise SkillFailure(*refused)
        self._check_lease(lease)
        return await self._robot.grip(width_m, force_n, lease)

    async def halt(self) -> None:
        """Brake; never delayed by the gate."""
        await self._robot.halt()

    async def stop(self) -> None:
        """Brake and latch; never delayed by the gate."""
        await self._robot.stop()

    async def enable(self) -> None:
        """Clear a stop."""
        await self._robot.enable()

    def brake(self) -> None:
        """Order the arm to brake; never delayed by the gate."""
        self._robot.brake()

    async def recover(self) -> None:
        """Clear a fault."""
        await self._robot.recover()

    def _check_tool(self, trajectory: JointTrajectory) -> None:
        """Require the tool centre point inside the box and below its speed, by its positions at the samples."""
        places = tcp_matrices(self.arm, trajectory.q_rad)[:, :3, 3]
        if self._T_world_base is not None:
            places = geometry.transform(self._T_world_base, places)
        lower, upper = self._workspace.lower_m, self._workspace.upper_m
        outside = np.flatnonzero(np.any((places < lower) | (places > upper), axis=-1))
        if len(outside):
            first = outside[0]
            raise SkillFailure(
                RobotReason.OUTSIDE_WORKSPACE,
                f"the tool would be at {np.round(places[first], 3).tolist()} m at {trajectory.times_s[first]:.3f} s, "
                f"outside the box from {lower} to {upper}; choose a target inside, or widen the workspace of the arm "
                "in the installation file",
            )
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(trajectory.times_s)
        fastest, allowed = float(speeds.max()), self._config.largest_tool_speed_m_s
        if fastest > allowed:
            raise SkillFailure(
                RobotReason.TOOL_SPEED,
                f"the tool would move at {fastest:.3f} m/s, allowed are {allowed} (--gate.largest-tool-speed-m-s); "
                "move slower, or through another posture",
            )

    def _check_lease(self, lease: Lease) -> None:
        if not (0.0 < lease.duration_s < math.inf and self._may_move(lease.holder)):
            caller = lease.holder or "a caller without a name"
            raise SkillFailure(
                RobotReason.LEASE_LOST,
                f"{caller} does not hold this arm's lease, or not for a finite time ({lease.duration_s} s); take the "
                "lease for a finite time, and renew it",
            )


def _stale() -> SkillFailure:
    return SkillFailure(
        RobotReason.STALE_FEEDBACK,
        f"the arm was braked: its feedback was older than {FEEDBACK_AGE_S} s on the way; is its driver running, and "
        "the machine not overloaded?",
    )


def _not_standing(state: RobotState, age_s: float, waited_s: float) -> SkillFailure:
    if age_s > FEEDBACK_AGE_S:
        return SkillFailure(
            RobotReason.STALE_FEEDBACK,
            f"no feedback of the arm younger than {FEEDBACK_AGE_S} s came within {waited_s:.1f} s; "
            "is its driver running, and the machine not overloaded?",
        )
    return SkillFailure(
        RobotReason.WRONG_START,
        f"the arm moves at {np.abs(state.dq_rad_s).max():.3f} rad/s where a motion starts, and has moved for "
        f"{waited_s:.1f} s; stop it first",
    )


@dataclass(eq=False)
class _FreshFeedback:
    """A deadline: it expires when the newest feedback of an arm is too old, by the clock of its stamps."""

    robot: Robot
    lost: bool = False

    @property
    def left_s(self) -> float:
        """Time until the feedback is too old [s], as `Deadline`."""
        return FEEDBACK_AGE_S - (self.robot.now_ns() - self.robot.newest_ns()) / 1e9

    def brake(self) -> None:
        """Order the arm to brake, and note that feedback was lost; called when the deadline has expired."""
        self.lost = True
        self.robot.brake()


class _Feedback:
    """Age of an arm's state by the time at which it was first seen: the clock of its stamp can pause."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # the lease's watch runs in its own thread
        self._stamp_ns = -1
        self._looked_ns = -math.inf
        self._newer_than_ns = -math.inf

    def begin(self, now_ns: int) -> None:
        """Note that the driver connects now: feedback found later is no older."""
        with self._lock:
            self._looked_ns = now_ns

    def age_s(self, stamp_ns: int, now_ns: int) -> float:
        """Largest age of the state with that stamp [s]: it arrived after the last check that found another stamp."""
        with self._lock:
            if stamp_ns != self._stamp_ns:
                self._stamp_ns, self._newer_than_ns = stamp_ns, self._looked_ns
            self._looked_ns = now_ns
            return (now_ns - self._newer_than_ns) / 1e9
