"""The requirements on a robot that `check_robot` tries, one after another; the arm moves slowly."""

import asyncio
import math
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import psutil

from dlokit import geometry
from dlokit.communication.timing.pulse import Pulse
from dlokit.errors import SkillFailure, StartNotConfirmed
from dlokit.extras.checks.checks import Unmet
from dlokit.extras.checks.device_report import spread
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import FEEDBACK_AGE_S
from dlokit.geometry import matrix
from dlokit.motion.forward_kinematics import tcp_matrices, tcp_pose
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory, Lease, RobotMode, RobotReason, RobotState

TURN_RAD = 0.06
"""Angle by which each joint turns there and back [rad]: 3.4°."""
SPEED_RAD_S = 0.06
"""Largest speed of a joint [rad/s]: a tool 0.8 m from the base moves at 5 cm/s when one joint turns."""
LARGEST_ERROR_RAD = 0.02
"""Largest tracking error, at any moment and at the end [rad]; an FR3 in simulation is at 6 mrad at this speed."""
BRAKED_S = 0.5
"""Longest time from an order to brake to an arm at rest at this speed [s]; an FR3 in simulation needs 0.25."""
CONFIRMED_S = 1.0
"""Longest time until `stop` returns [s]."""
RATE_HZ = 100.0
"""Least rate of new states [Hz]."""
LARGEST_WIDTH_ERROR_M = 0.003
"""Largest difference between an ordered width and a measured one, with nothing between the fingers [m]."""
FORCE_N = 20.0
"""Force of the fingers [N], where the gripper has it."""

_REST_RAD = 2e-3  # an arm that stays within this of its final angles is at rest; a simulated arm swings by 1e-4
_LOOK_S = 0.004
_STATES_S = 1.0
_REFUSED_S = 0.3
_STEP_RAD, _STEP_S = 3e-3, 0.005
_LEAST_DROP_M = 0.005
_PLACE_M = 1e-3
_LEASE = Lease(holder="check", duration_s=0.2)

WANTED = {
    "connects": "entering connects within its own time limit, and the arm is at rest without a latched stop",
    "arm": "a title and joint limits; a state of as many joints, within their limits; the tool where forward "
    "kinematics puts it, to 1 mm",
    "state": f"new states at {RATE_HZ:g} Hz or at the rate that the driver states, finite, with rising stamps, at most "
    f"{FEEDBACK_AGE_S:g} s old by the driver's clock",
    "limits": "a trajectory that leaves the range of a joint is refused as joint_limit, and one with a jump as "
    "velocity_limit, acceleration_limit or jerk_limit, before the arm moves",
    "lease": "a motion and a grip of a caller without a lease, and with one that has ended or never ends, are refused "
    "as lease_lost",
    "motion": f"a slow motion is followed to {1e3 * LARGEST_ERROR_RAD:g} mrad, there and back",
    "brake": f"brake, called from another thread in a motion, ends it as stopped; the arm is at rest "
    f"after {BRAKED_S:g} s",
    "heartbeat": "in a motion the driver sends heartbeats by the pulse with which it was built; without them the arm "
    f"brakes within the lease and {BRAKED_S:g} s, and the motion fails as lost_commander; recover makes the arm usable "
    "again",
    "stop": f"stop ends a motion as stopped and returns within {CONFIRMED_S:g} s with the arm at rest; motions and "
    "grips are refused as stop_latched, also after recover, until enable",
    "grip": f"the fingers open and close to the ordered width, measured to {1e3 * LARGEST_WIDTH_ERROR_M:g} mm, and "
    "hold nothing where nothing is between them",
    "recover": "recover without a fault changes nothing: the arm stays where it is, idle",
    "closes": "after leaving, no process of the driver runs, and entering again connects",
    "latch": "a stop outlives the driver, because the arm or its controller keeps it: after stop and leaving, a new "
    "process that opens the driver sees stop_latched, until enable",
}
"""The requirement of each check, in the order of the checks."""

PLAN = (
    "The check reads the state for some seconds, and asks for motions that must be refused.",
    f"Then each joint turns by {math.degrees(TURN_RAD):.1f} degrees and back, at most {math.degrees(SPEED_RAD_S):.1f} "
    "degrees/s: once to its end, then braked, left without "
    "heartbeats, and stopped in motion: four times in all.",
    "Then the fingers close, open to a half, and open; some grippers home first. The arm ends where it began.",
    "After the first failed check nothing moves. Ctrl-C brakes the arm at any time.",
)
"""The motions, shown to the operator first."""
QUESTIONS = (
    "Is the space within 15 cm of the arm, its tool and its load clear, and are the fingers empty?",
    "Do you have a hand on the emergency stop? With yes the arm moves.",
)
LATCHED_QUESTION = "The stop of the arm is latched. Have you removed its cause, and may the arm be enabled?"

Confirm = Callable[[str], Awaitable[bool]]
"""Asks the operator one question; True only for a clear yes."""
LatchSeen = Callable[[], Awaitable[bool]]
"""Whether a new process that opens the driver sees a latched stop."""


class SilenceablePulse:
    """Heartbeats that a check can silence, as if the commander had died."""

    def __init__(self, pulse: Pulse) -> None:
        """`pulse` sends them."""
        self._pulse = pulse
        self.is_silent = False
        self.sent = 0

    @asynccontextmanager
    async def __call__(self, send: Callable[[], None], period_s: float) -> AsyncGenerator[None]:
        """Send heartbeats, unless they were silenced."""

        def beat() -> None:
            if not self.is_silent:
                self.sent += 1
                send()

        async with self._pulse(beat, period_s):
            yield


class _Failed(Exception):
    """A check has failed; no further motion follows."""


@dataclass
class RobotUnderTest:
    """One robot, with the findings so far."""

    robot: Robot
    confirm: Confirm | None
    rate_hz: float
    pulse: SilenceablePulse
    latch_seen: LatchSeen
    check: str = "connects"
    """The present check."""
    tried: list[str] = field(default_factory=list[str])
    found: list[Unmet] = field(default_factory=list[Unmet])
    facts: dict[str, str] = field(default_factory=dict[str, str])
    timing: dict[str, str] = field(default_factory=dict[str, str])
    pids: set[int] = field(default_factory=set[int])

    def wrong(self, text: str) -> None:
        """Note a violated requirement of the present check."""
        self.found.append(Unmet(check=self.check, wrong=text, wanted=WANTED[self.check]))

    def require(self, is_so: bool, otherwise: str) -> None:
        """End the checks unless a condition holds. Raises `_Failed`."""
        if not is_so:
            self.wrong(otherwise)
            raise _Failed

    async def ask(self, question: str) -> None:
        """Raise `StartNotConfirmed` unless the operator says yes; without an operator, continue."""
        if self.confirm is not None and not await self.confirm(question):
            raise StartNotConfirmed(f"the operator said no to: {question}")


async def try_all(tested: RobotUnderTest) -> None:
    """Connect, try the requirements until one is not met, disconnect. Raises `StartNotConfirmed`."""
    before = _children()
    began_s = time.perf_counter()
    try:
        async with tested.robot:
            tested.timing["connecting"] = f"{time.perf_counter() - began_s:.2f} s"
            tested.pids = _children() - before
            await _try_connected(tested)
    except StartNotConfirmed:
        raise
    except Exception as error:  # a driver may raise anything
        tested.check = "closes" if tested.tried else "connects"
        tested.wrong(f"{type(error).__name__}: {error}")
    if tested.tried:
        await _check_closing(tested, before)
    if not tested.found:
        await _check_latch(tested)


async def _try_connected(tested: RobotUnderTest) -> None:
    for name, check in _CHECKS:
        tested.check = name
        try:
            await check(tested)
            tested.tried.append(name)
        except StartNotConfirmed:
            raise
        except _Failed:
            return
        except Exception as error:  # a driver may raise anything
            tested.wrong(f"{type(error).__name__}: {error}")
            return


async def _check_connected(tested: RobotUnderTest) -> None:
    state = tested.robot.state()
    if state.stop_latched and tested.confirm is not None:
        await tested.ask(LATCHED_QUESTION)
        await tested.robot.enable()
        await asyncio.sleep(0.1)
        state = tested.robot.state()
    tested.require(not state.stop_latched, "its stop is latched; a person must enable it first")
    tested.require(state.mode is RobotMode.IDLE, f"its mode is {state.mode.value}")


async def _check_arm(tested: RobotUnderTest) -> None:
    arm, state = tested.robot.arm, tested.robot.state()
    limits, joints = arm.limits, len(arm.limits.velocity_rad_s)
    tested.facts |= {
        "arm": f"{arm.title}, called {state.robot}",
        "angles [rad]": str(np.round(state.q_rad, 4).tolist()),
        "tool in the world [m]": str(np.round(state.T_world_tcp.position_m, 4).tolist()),
        "fingers [m]": f"{state.finger_width_m:.4f}",
    }
    tested.require(bool(arm.title and state.robot), "the arm has no name")
    tested.require(
        bool(np.all(limits.position_lower_rad < limits.position_upper_rad)), "a joint's lower limit is not the lower"
    )
    shape = state.q_rad.shape
    tested.require(shape == (joints,), f"the state has angles of shape {shape}, the arm {joints} joints")
    within = (state.q_rad >= limits.position_lower_rad) & (state.q_rad <= limits.position_upper_rad)
    tested.require(bool(within.all()), f"joint {int(np.argmin(within)) + 1} is outside its limits")
    tool = tcp_pose(arm, state.q_rad)
    if state.T_world_base is not None:
        tool = geometry.compose(state.T_world_base, tool)
    off_m = float(np.linalg.norm(matrix(tool)[:3, 3] - state.T_world_tcp.position_m))
    tested.require(off_m <= _PLACE_M, f"the tool is {1e3 * off_m:.1f} mm from where the model has it at these angles")


async def _check_state(tested: RobotUnderTest) -> None:
    states = [tested.robot.state()]
    ages_s: list[float] = []
    end_s = _now_s() + _STATES_S
    while _now_s() < end_s:
        await asyncio.sleep(2e-3)
        state = tested.robot.state()
        ages_s.append((tested.robot.now_ns() - state.stamp_ns) / 1e9)
        if state.stamp_ns != states[-1].stamp_ns:
            states.append(state)
    rate_hz = (len(states) - 1) / _STATES_S
    tested.facts["new states"] = f"{rate_hz:.0f} Hz"
    tested.timing["age of the state"] = spread(ages_s)
    # A tenth less: the samples are taken by a busy machine.
    tested.require(rate_hz >= 0.9 * tested.rate_hz, f"{rate_hz:.0f} new states a second, not {tested.rate_hz:g}")
    steps_ns = np.diff([state.stamp_ns for state in states])
    tested.timing["between stamps"] = spread((steps_ns / 1e9).tolist())
    tested.require(bool((steps_ns > 0).all()), "stamps go back")
    tested.require(all(map(_is_finite, states)), "angles, speeds, torques or width are not finite")
    oldest_s = max(ages_s)
    tested.require(oldest_s <= FEEDBACK_AGE_S, f"a state was {oldest_s:.3f} s old")


def _is_finite(state: RobotState) -> bool:
    values = (state.q_rad, state.dq_rad_s, state.tau_nm, state.T_world_tcp.position_m, state.finger_width_m)
    return all(bool(np.isfinite(value).all()) for value in values)


async def _check_limits(tested: RobotUnderTest) -> None:
    q_rad = tested.robot.state().q_rad
    await _refused(
        tested,
        tested.robot.follow(_beyond_range(tested.robot, q_rad), _LEASE),
        {RobotReason.JOINT_LIMIT},
        "a trajectory to 0.05 rad outside the range of a joint",
    )
    await _refused(
        tested,
        tested.robot.follow(_jump(tested.robot.state().q_rad), _LEASE),
        {RobotReason.VELOCITY_LIMIT, RobotReason.ACCELERATION_LIMIT, RobotReason.JERK_LIMIT},
        f"a jump by {1e3 * _STEP_RAD:g} mrad in {1e3 * _STEP_S:g} ms",
    )


async def _check_lease(tested: RobotUnderTest) -> None:
    leases = {
        "a caller without a name": Lease(holder="", duration_s=0.2),
        "a lease that has ended": Lease(holder="check", duration_s=0.0),
        "a lease that never ends": Lease(holder="check", duration_s=math.inf),
    }
    trajectory = _small(tested.robot)
    for who, lease in leases.items():
        await _refused(tested, tested.robot.follow(trajectory, lease), {RobotReason.LEASE_LOST}, f"a motion of {who}")
        width_m = _width_m(tested.robot)
        await _refused(
            tested,
            tested.robot.grip(width_m, _force_n(tested.robot), lease),
            {RobotReason.LEASE_LOST},
            f"a grip of {who}",
        )


async def _check_motion(tested: RobotUnderTest) -> None:
    for question in QUESTIONS:
        await tested.ask(question)
    robot, errors = tested.robot, list[float]()
    begin = robot.state().q_rad
    for trajectory in (_small(robot), None):
        target = begin if trajectory is None else trajectory.q_rad[-1]
        result = await robot.follow(_slow(robot, target) if trajectory is None else trajectory, _LEASE)
        measured = float(np.abs(robot.state().q_rad - target).max())
        errors += [result.largest_joint_error_rad, measured]
        said = f"largest error in a motion {1e3 * errors[-2]:.1f} mrad, at its end {1e3 * measured:.1f} mrad"
        tested.require(max(errors) <= LARGEST_ERROR_RAD, said)
    tested.facts["tracking error"] = (
        f"{1e3 * max(errors[::2]):.1f} mrad in the motion, {1e3 * max(errors[1::2]):.1f} mrad at its end"
    )


async def _check_brake(tested: RobotUnderTest) -> None:
    begin = tested.robot.state().q_rad

    async def brake() -> None:
        if _is_real_time():
            await asyncio.to_thread(tested.robot.brake)
        else:  # virtual time would advance during a wait for a thread
            tested.robot.brake()

    standing_s, _ = await _ended_by(tested, brake, RobotReason.STOPPED)
    tested.timing["from brake to rest"] = f"{1e3 * standing_s:.0f} ms"
    tested.require(standing_s <= BRAKED_S, f"the arm was at rest {standing_s:.2f} s after the order")
    await _back(tested, begin)


async def _check_heartbeat(tested: RobotUnderTest) -> None:
    pulse = tested.pulse
    tested.require(pulse.sent > 0, "it sent no heartbeats in the motions before, so that their end cannot be tried")
    begin = tested.robot.state().q_rad

    async def fall_silent() -> None:
        pulse.is_silent = True

    try:
        standing_s, _ = await _ended_by(tested, fall_silent, RobotReason.LOST_COMMANDER)
    finally:
        pulse.is_silent = False
    tested.timing["from the last heartbeat to rest"] = f"{1e3 * standing_s:.0f} ms"
    allowed_s = _LEASE.duration_s + BRAKED_S
    tested.require(standing_s <= allowed_s, f"the arm was at rest {standing_s:.2f} s after the last heartbeat")
    await tested.robot.recover()
    await _back(tested, begin)


async def _check_stop(tested: RobotUnderTest) -> None:
    robot = tested.robot
    begin = robot.state().q_rad
    standing_s, confirmed_s = await _ended_by(tested, robot.stop, RobotReason.STOPPED)
    tested.timing["from stop to rest"] = f"{1e3 * standing_s:.0f} ms, confirmed after {1e3 * confirmed_s:.0f} ms"
    tested.require(confirmed_s <= CONFIRMED_S, f"stop returned after {confirmed_s:.2f} s")
    tested.require(standing_s <= max(BRAKED_S, confirmed_s), f"the arm was at rest only after {standing_s:.2f} s")
    for when in ("after a stop", "after recover"):
        if when == "after recover":
            await robot.recover()
        tested.require(robot.state().stop_latched, f"{when} the state does not say that the stop is latched")
        latched = {RobotReason.STOP_LATCHED}
        await _refused(tested, robot.follow(_slow(robot, begin), _LEASE), latched, f"a motion {when}")
        width_m = _width_m(robot)
        await _refused(tested, robot.grip(width_m, _force_n(robot), _LEASE), latched, f"a grip {when}")
    await robot.enable()
    await asyncio.sleep(0.1)
    tested.require(not robot.state().stop_latched, "enable does not clear the stop")
    await _back(tested, begin)


async def _check_grip(tested: RobotUnderTest) -> None:
    robot, widths = tested.robot, list[str]()
    open_m = robot.arm.gripper.open_width_m
    for wanted_m in (0.0, 0.5 * open_m, 0.9 * open_m):
        result = await robot.grip(wanted_m, _force_n(robot), _LEASE)
        await asyncio.sleep(0.1)
        measured_m = robot.state().finger_width_m
        widths.append(f"{1e3 * wanted_m:.0f}: {1e3 * result.width_m:.1f}")
        for name, width_m in (("the result", result.width_m), ("the state", measured_m)):
            tested.require(
                abs(width_m - wanted_m) <= LARGEST_WIDTH_ERROR_M,
                f"ordered {1e3 * wanted_m:.1f} mm, {name} says {1e3 * width_m:.1f} mm",
            )
        tested.require(not result.held, f"at {1e3 * wanted_m:.0f} mm the fingers hold something where nothing is")
    tested.facts["widths, ordered: measured [mm]"] = ", ".join(widths)


async def _check_recover(tested: RobotUnderTest) -> None:
    before = tested.robot.state()
    await tested.robot.recover()
    await asyncio.sleep(0.1)
    after = tested.robot.state()
    moved_rad = float(np.abs(after.q_rad - before.q_rad).max())
    tested.require(moved_rad <= _REST_RAD, f"the arm moved by {1e3 * moved_rad:.1f} mrad")
    tested.require(after.mode is RobotMode.IDLE, f"its mode is {after.mode.value}")


_CHECKS = (
    ("connects", _check_connected),
    ("arm", _check_arm),
    ("state", _check_state),
    ("limits", _check_limits),
    ("lease", _check_lease),
    ("motion", _check_motion),
    ("brake", _check_brake),
    ("heartbeat", _check_heartbeat),
    ("stop", _check_stop),
    ("grip", _check_grip),
    ("recover", _check_recover),
)


async def _check_closing(tested: RobotUnderTest, before: set[int]) -> None:
    tested.check = "closes"
    left = _running(tested.pids)
    if left:
        tested.wrong(f"{len(left)} of its processes still run: {', '.join(map(str, left))}")
    try:
        async with tested.robot:
            tested.robot.state()
            pids = _children() - before
        if not left and (left := _running(pids)):
            tested.wrong(f"{len(left)} of its processes still run: {', '.join(map(str, left))}")
    except Exception as error:  # a driver may raise anything
        tested.wrong(f"entered again, it raises {type(error).__name__}: {error}")
    tested.tried.append("closes")


async def _check_latch(tested: RobotUnderTest) -> None:
    tested.check, robot = "latch", tested.robot
    try:
        async with robot:
            await robot.stop()
        try:
            is_seen = await tested.latch_seen()
        finally:
            async with robot:
                await asyncio.sleep(0.1)
                is_kept = robot.state().stop_latched
                await robot.enable()
        if not is_seen:
            tested.wrong("a new process that opened the driver after a stop saw none: the driver's memory has it")
        elif not is_kept:
            tested.wrong("entered again after a stop, the state does not say that the stop is latched")
        tested.tried.append("latch")
    except Exception as error:  # a driver may raise anything
        tested.wrong(f"{type(error).__name__}: {error}")


async def _refused(tested: RobotUnderTest, motion: Awaitable[object], reasons: set[RobotReason], what: str) -> None:
    """Require that a motion is refused; brake an accepted one early. Raises `_Failed`."""
    moving = asyncio.ensure_future(motion)
    await asyncio.wait({moving}, timeout=_REFUSED_S)
    if not moving.done():
        moving.cancel()
        await asyncio.gather(moving, return_exceptions=True)
        await tested.robot.halt()
        tested.require(False, f"{what} was accepted")
    error = moving.exception()
    tested.require(error is not None, f"{what} was accepted")
    named = error.reason if isinstance(error, SkillFailure) else f"{type(error).__name__}: {error}"
    tested.require(named in reasons, f"{what} was refused as {named}")


async def _ended_by(
    tested: RobotUnderTest, order: Callable[[], Coroutine[Any, Any, None]], reason: RobotReason
) -> tuple[float, float]:
    """Give an order in mid-motion; returns when the arm came to rest and when the order returned, both after it [s].

    Raises `_Failed` unless the motion fails by `reason`.
    """
    robot = tested.robot
    trajectory = _small(robot)
    moving = asyncio.ensure_future(robot.follow(trajectory, _LEASE))
    try:
        await asyncio.sleep(0.4 * float(trajectory.times_s[-1]))
        tested.require(not moving.done(), "the motion ended before its time")
        began_s, samples = _now_s(), list[tuple[float, Float64Array]]()
        ordered = asyncio.ensure_future(order())
        returned_s = math.inf
        while (at_s := _now_s() - began_s) < BRAKED_S + 1.0:
            samples.append((at_s, robot.state().q_rad))
            if ordered.done() and returned_s == math.inf:
                ordered.result()
                returned_s = at_s
            await asyncio.sleep(_LOOK_S)
        tested.require(moving.done(), f"the motion continues {at_s:.1f} s after the order")
        error = moving.exception()
        tested.require(error is not None, "the motion ran to its end")
        named = error.reason if isinstance(error, SkillFailure) else f"{type(error).__name__}: {error}"
        tested.require(named == reason.value, f"the motion ended as {named}, not as {reason}")
    finally:
        if not moving.done():
            moving.cancel()
            await asyncio.gather(moving, return_exceptions=True)
    last = samples[-1][1]
    moved = [at_s for at_s, q_rad in samples if float(np.abs(q_rad - last).max()) > _REST_RAD]
    return (moved[-1] if moved else 0.0), returned_s


async def _back(tested: RobotUnderTest, begin: Float64Array) -> None:
    """Return to where a check began. Raises `_Failed`."""
    await tested.robot.follow(_slow(tested.robot, begin), _LEASE)
    off_rad = float(np.abs(tested.robot.state().q_rad - begin).max())
    tested.require(off_rad <= LARGEST_ERROR_RAD, f"moved back, the arm is {1e3 * off_rad:.1f} mrad off")


def _small(robot: Robot) -> JointTrajectory:
    """A turn of each joint that lowers the tool by a few millimetres at most; else of the first and the last joint."""
    arm, q_rad = robot.arm, robot.state().q_rad
    limits = arm.limits
    heights = tcp_matrices(arm, np.vstack([q_rad, q_rad + TURN_RAD * np.eye(len(q_rad))]))[:, 2, 3]
    middle = (limits.position_lower_rad + limits.position_upper_rad) / 2.0
    inwards = np.where(q_rad < middle, 1.0, -1.0)
    raises = heights[1:] - heights[0]
    signs = np.where(np.abs(raises) < 1e-4, inwards, np.sign(raises))
    near = np.minimum(q_rad - limits.position_lower_rad, limits.position_upper_rad - q_rad) < 2.0 * TURN_RAD
    turn = TURN_RAD * np.where(near, inwards, signs)
    along = tcp_matrices(arm, q_rad + np.linspace(0.0, 1.0, 11)[:, None] * turn)[:, 2, 3]
    if along.min() < along[0] - _LEAST_DROP_M:
        turn[1:-1] = 0.0
    return _slow(robot, q_rad + turn)


def _slow(robot: Robot, target: Float64Array) -> JointTrajectory:
    """From where the arm is to `target` (J,) [rad], at `SPEED_RAD_S` at most."""
    fast = joint_move(robot.state().q_rad, target, robot.arm.limits)
    peak = float(np.abs(fast.dq_rad_s).max())
    return scaled(fast, min(1.0, SPEED_RAD_S / peak)) if peak > 0.0 else fast


def _beyond_range(robot: Robot, q_rad: Float64Array) -> JointTrajectory:
    """A motion to 0.05 rad past the nearer end of the first joint's range, slow enough to be braked early."""
    limits = robot.arm.limits
    lower, upper = limits.position_lower_rad[0], limits.position_upper_rad[0]
    target = upper + 0.05 if upper - q_rad[0] < q_rad[0] - lower else lower - 0.05
    u = np.linspace(0.0, 1.0, 401)[:, None]
    span, duration_s = np.zeros(len(q_rad)), 100.0
    span[0] = target - q_rad[0]
    return JointTrajectory(
        times_s=u[:, 0] * duration_s,
        q_rad=q_rad + span * u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
        dq_rad_s=span * 30.0 * u**2 * (1.0 - u) ** 2 / duration_s,
        ddq_rad_s2=span * (60.0 * u - 180.0 * u**2 + 120.0 * u**3) / duration_s**2,
    )


def _jump(q_rad: Float64Array) -> JointTrajectory:
    """A step of the last joint far above its acceleration limit, and harmless if the driver runs it."""
    angles = np.tile(q_rad, (4, 1))
    angles[2:, -1] += _STEP_RAD
    zero = np.zeros_like(angles)
    return JointTrajectory(times_s=_STEP_S * np.arange(4.0), q_rad=angles, dq_rad_s=zero, ddq_rad_s2=zero)


def _width_m(robot: Robot) -> float:
    """The present width of the fingers, within their range [m]."""
    return min(max(robot.state().finger_width_m, 0.0), robot.arm.gripper.open_width_m)


def _force_n(robot: Robot) -> float:
    return min(FORCE_N, robot.arm.gripper.force_n)


def _is_real_time() -> bool:
    return abs(asyncio.get_running_loop().time() - time.monotonic()) < 1.0


def _now_s() -> float:
    return asyncio.get_running_loop().time()


def _children() -> set[int]:
    return {child.pid for child in psutil.Process().children(recursive=True)}


def _running(pids: Iterable[int]) -> list[int]:
    """The running processes, without zombies."""
    running: list[int] = []
    for pid in sorted(pids):
        try:
            if psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
                running.append(pid)
        except psutil.NoSuchProcess:
            continue
    return running
