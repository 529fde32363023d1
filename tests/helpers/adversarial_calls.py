"""Random and adversarial calls of the robot's skills, in lockstep with the simulated cell, and their outcomes."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

import msgspec
import numpy as np
from adversarial import KINEMATICS, Executed, honest_pose, spoilt_pose, spoilt_profile
from cell_bench import CellBench
from message_damage import mutated

from dlokit import geometry
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.skill import Skill, SkillCall
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.transport import CallHandler
from dlokit.communication.wire import codec
from dlokit.description.arm.franka import PANDA
from dlokit.errors import CommunicationError
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.functional.robots.simulated import SimulatedRobot
from dlokit.geometry import downward
from dlokit.motion.tool_path import half_turned
from dlokit.skills.robot import api
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, Succeeded, TimedOut
from dlokit.types.pose import Pose
from dlokit.types.robot import GripResult, JointTrajectory, Lease, MotionResult

Rng = np.random.Generator
Arguments = tuple[Any, ...]

RAN_ANYWAY = ("error", "malformed_outcome", "result_not_encodable", "timeout_inside")
"""Reasons of unexpected exceptions, which no skill declares."""
SETTLE_S = 0.3
"""Time after each call [s], in which the arm settles (up to 6 mm after its last set-point) or brakes."""
AT_GOAL_RAD, AT_GOAL_M = 5e-3, 2e-3
"""Largest deviation of measured joints and tool from the goal after that time."""


@dataclass
class CallResult:
    """Result of one call."""

    kind: str
    refused_when_made: bool = False
    reason: str = ""
    """Why it did not succeed; empty if it did."""
    moved: bool = False
    broken: list[str] = field(default_factory=list[str])
    wrong: list[str] = field(default_factory=list[str])
    planning_s: float = 0.0
    largest_mib: float = 0.0


class OpenTransport(MemoryTransport):
    """A bus of one process that also takes calls as bytes."""

    def __init__(self) -> None:
        super().__init__()
        self._by_component: dict[str, CallHandler] = {}

    def serve(self, component: str, handler: CallHandler) -> None:
        self._by_component[component] = handler
        super().serve(component, handler)

    async def call_bytes(self, skill: Skill[..., Any], arguments: bytes, number: int) -> Outcome[Any]:
        """Call a skill with unchecked arguments."""
        call = SkillCall(
            component=skill.component,
            skill=skill.name,
            arguments=arguments,
            call_id=f"bytes-{number}",
            caller="memory",
            schema=skill.schema,
        )
        answer = await self._by_component[skill.component](call, lambda _: None)
        try:
            return codec.decode(answer, skill.outcome_type)
        except CommunicationError as error:
            return Failed(reason="malformed_outcome", detail=str(error))


def _decoded(skill: Skill[..., Any], data: bytes) -> dict[str, Any]:
    return msgspec.structs.asdict(codec.decode(data, skill.arguments_type))


class TimedRobot(SimulatedRobot):
    """The driver, which records its first command to move."""

    ordered_s = float("nan")

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        self._note()
        return await super().follow(trajectory, lease)

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        self._note()
        return await super().grip(width_m, force_n, lease)

    def _note(self) -> None:
        if np.isnan(self.ordered_s):
            self.ordered_s = time.perf_counter()


class Batch:
    """Calls to one cell, one after the other."""

    def __init__(
        self, rng: Rng, begin_memory: Callable[[], None], memory_mib: Callable[[], float], config: GateConfig
    ) -> None:
        self._rng = rng
        self._begin_memory, self._memory_mib = begin_memory, memory_mib
        self._config = config
        self._executed = Executed()
        self._bus = OpenTransport()
        self._clock = LoopClock()
        self._driver = TimedRobot(self._port("robot driver"))
        self._caller = self._port("test")
        self._count = 0
        self._how = ""

    @property
    def used(self) -> dict[str, float]:
        """Largest fraction of each limit that was used."""
        return self._executed.used

    def _port(self, owner: str) -> Port:
        return Port(self._bus, self._clock, InlineCompute(), owner=owner, publishes=())

    async def run(self, calls: int, note: Callable[[CallResult], None]) -> None:
        """Make that many calls."""
        host = CellBench(bus=self._bus, seed=int(self._rng.integers(1000))).host
        robot = GatedRobot(self._driver, self._config, self._clock.now_ns)
        host.add(RobotComponent(RobotConfig(), robot, lambda: 0))
        with self._executed.noted():
            async with host:
                await asyncio.sleep(0.2)
                for _ in range(calls):
                    note(await self._one())

    async def _one(self) -> CallResult:
        shares = np.array([SHARES.get(kind, 1.0) for kind in CALLS])
        kind = str(self._rng.choice(list(CALLS), p=shares / shares.sum()))
        skill, arguments = CALLS[kind](self._rng)
        result = CallResult(kind)
        self._count += 1
        self._executed.forget()
        self._driver.ordered_s, physics_s = float("nan"), self._executed.physics_s
        chance = self._rng.random()
        self._how = "damaged" if chance < 0.3 else ""
        width_m = self._driver.state().finger_width_m
        self._begin_memory()
        began_s = time.perf_counter()
        if chance < 0.3:
            outcome, decoded = await self._sent_damaged(skill, arguments)
        else:
            outcome, decoded = await self._sent(skill, arguments, interrupted=chance > 0.85)
        ended_s = time.perf_counter() - (self._executed.physics_s - physics_s)
        result.planning_s = (ended_s if np.isnan(self._driver.ordered_s) else self._driver.ordered_s) - began_s
        result.largest_mib = self._memory_mib()
        _note_outcome(result, outcome)
        await self._caller.clock.sleep(SETTLE_S)
        if isinstance(outcome, Succeeded):
            result.wrong += self._not_reached(skill, decoded)
        closed_m = abs(self._driver.state().finger_width_m - width_m)
        result.moved = self._executed.moved() or closed_m > 1e-3
        result.broken = [f"{breach} ({self._how or 'alone'})" for breach in self._executed.breaches(self._config)]
        await self._ready_again()
        return result

    async def _sent(self, skill: Skill[..., Any], arguments: Arguments, interrupted: bool) -> tuple[Outcome[Any], Any]:
        try:
            decoded = _decoded(skill, skill.request("id-1", "id", *arguments).arguments)
        except CommunicationError:
            decoded = None
        call = asyncio.create_task(self._caller.call(skill, *arguments))
        if interrupted:
            await self._interrupt(call)
        outcomes = await asyncio.gather(call, return_exceptions=True)
        if isinstance(outcomes[0], asyncio.CancelledError):
            return Cancelled(), decoded
        assert not isinstance(outcomes[0], BaseException), outcomes[0]
        return outcomes[0], decoded

    async def _interrupt(self, call: "asyncio.Task[Outcome[Any]]") -> None:
        """Halt, stop, cancel, or another call, at any time of the motion."""
        await asyncio.wait([call], timeout=float(self._rng.uniform(0.0, 1.0)))
        if call.done():
            return
        how = int(self._rng.integers(4))
        self._how = f"interrupted {how}"
        if how == 0:
            call.cancel()
            return
        skill: Skill[..., Any] = (api.HALT, api.STOP, api.HOME)[how - 1]
        await self._caller.call(skill)

    async def _sent_damaged(self, skill: Skill[..., Any], arguments: Arguments) -> tuple[Outcome[Any], Any]:
        """The same as bytes, some of which are damaged."""
        try:
            data = skill.request("id-1", "id", *arguments).arguments
        except CommunicationError:
            data = b""
        data = mutated(data, Random(int(self._rng.integers(2**32))))
        outcome = await self._bus.call_bytes(skill, data, self._count)
        try:
            return outcome, _decoded(skill, data)
        except CommunicationError:
            return outcome, None

    async def _ready_again(self) -> None:
        """Release the lease, enable and recover, so that this call does not affect the next."""
        await self._caller.call(api.RELEASE_LEASE, "memory")
        await self._caller.call(api.ENABLE)
        await self._caller.call(api.RECOVER)

    def _not_reached(self, skill: Skill[..., Any], decoded: dict[str, Any] | None) -> list[str]:
        """Requested results that were not achieved although the skill succeeded."""
        if decoded is None:
            return ["succeeded with arguments that cannot be decoded"]
        if not _valid(decoded):
            return [f"succeeded with {decoded}"]
        commanded, measured = self._executed.commanded[-1], self._executed.measured[-1]
        width_m = self._driver.state().finger_width_m
        match skill.name:
            case "move_joints" | "home":
                goal = decoded.get("q_rad", PANDA.home_q_rad)
                off_rad = max(float(np.abs(q - goal).max()) / by for q, by in ((commanded, 1e-3), (measured, 1.0)))
                return [f"{off_rad} rad off"] if not off_rad <= AT_GOAL_RAD else []
            case "move_to":
                return _off_pose(measured, decoded["target"], decoded["either_way"])
            case "move_linear":
                return _off_pose(measured, decoded["target"], True)
            case "follow_path":
                return _off_pose(measured, decoded["path"][-1], True) if decoded["path"] else []
            case "release":
                held = self._driver.state().holding
                return [] if held or abs(width_m - decoded["width_m"]) < 1e-3 else [f"fingers at {width_m} m"]
            case "grasp":
                held = self._driver.state().holding
                return [] if held or width_m < AT_GOAL_M else [f"fingers at {width_m} m hold nothing"]
            case _:
                return []


def _note_outcome(result: CallResult, outcome: Outcome[Any]) -> None:
    match outcome:
        case Succeeded():
            return
        case Failed(reason=reason, detail=detail) | Rejected(reason=reason, detail=detail):
            result.reason = reason
            result.refused_when_made = reason == "bad_arguments"
            if reason in RAN_ANYWAY or not reason:
                result.wrong.append(f"ended as {reason}: {detail}")
        case TimedOut():
            result.reason = "timed_out"
            result.wrong.append("timed out")
        case _:
            result.reason = type(outcome).__name__.lower()


def _off_pose(q_rad: Float64Array, goal: Pose, either_way: bool) -> list[str]:
    """Deviation of the tool from a pose; `either_way` also allows the pose turned by half a turn."""
    T = KINEMATICS.forward(q_rad)
    off_m = float(np.linalg.norm(T.position_m - goal.position_m))
    ways = (goal, half_turned(goal)) if either_way else (goal,)
    cosine = max(abs(float(T.wxyz @ way.wxyz)) / float(np.linalg.norm(way.wxyz)) for way in ways)
    if off_m <= AT_GOAL_M and cosine >= np.cos(AT_GOAL_RAD):
        return []
    return [f"{off_m * 1e3:.2f} mm and {2.0 * np.arccos(min(1.0, cosine)):.4f} rad off"]


def _valid(value: Any) -> bool:
    """Whether all numbers are finite, quaternions unit, speeds above 0 and widths within the hand's range."""
    match value:
        case Pose():
            unit = abs(float(np.linalg.norm(value.wxyz)) - 1.0) < 2e-3
            return unit and bool(np.isfinite(value.position_m).all())
        case VelocityProfile():
            return all(0.0 < v < np.inf for v in (value.speed_m_s, value.acceleration_m_s2, value.jerk_m_s3))
        case dict():
            width, force = value.get("width_m", 0.0), value.get("force_n", 1.0)
            return 0.0 <= width <= 0.08 and 0.0 < force <= 70.0 and all(_valid(v) for v in value.values())
        case tuple() | list():
            return all(_valid(each) for each in value)
        case float() | np.ndarray():
            return bool(np.isfinite(value).all())
        case _:
            return True


def some_pose(rng: Rng) -> Pose:
    """A pose: valid, invalid, tilted, far away, or below the table."""
    chance = rng.random()
    if chance < 0.5:
        return honest_pose(rng)
    if chance < 0.65:
        return spoilt_pose(rng)
    tilt = geometry.pose([0.0, 0.0, 0.0], [1.0, *(rng.normal(size=3) * 10 ** rng.uniform(-5.0, 0.5))])
    pose = geometry.compose(honest_pose(rng), tilt)
    if chance > 0.85:
        pose = geometry.pose(pose.position_m + rng.normal(size=3) * 10 ** rng.uniform(-2.0, 3.0), pose.wxyz)
    return pose


def some_profile(rng: Rng) -> VelocityProfile:
    """A velocity profile: valid, invalid, or too small or large for any motion."""
    chance = rng.random()
    if chance < 0.6:
        return VelocityProfile(speed_m_s=10 ** rng.uniform(-1.3, 0.5))
    if chance < 0.75:
        return spoilt_profile(rng)
    v, a, j = 10 ** (rng.uniform(-3.0, 3.0, 3) if chance < 0.9 else rng.uniform(-300.0, 300.0, 3))
    return VelocityProfile(speed_m_s=v, acceleration_m_s2=a, jerk_m_s3=j)


def some_path(rng: Rng) -> tuple[Pose, ...]:
    """Few poses, or thousands: zigzags, circles, tilted or not, up to what the planner takes on."""
    chance = rng.random()
    if chance < 0.6:
        poses = [some_pose(rng) if rng.random() < 0.2 else honest_pose(rng) for _ in range(rng.integers(0, 6))]
        return tuple(poses + poses[:1] * int(rng.integers(0, 3)))
    count = int(10 ** rng.uniform(0.5, 3.5))
    place, wide_m = rng.uniform([0.4, -0.2, 0.1], [0.6, 0.2, 0.4]), 10 ** rng.uniform(-4.0, -0.8)
    tilt = [1.0, *(rng.normal(size=3) * (0.2 if rng.random() < 0.5 else 0.0))]
    turns = rng.uniform(0.0, 30.0)
    if rng.random() < 0.5:
        angles = np.linspace(0.0, 2.0 * np.pi * turns, count)
        places = place + wide_m * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    else:
        places = place + wide_m * np.column_stack([np.zeros(count), (-1.0) ** np.arange(count), np.zeros(count)])
    return tuple(geometry.compose(downward(p, 0.0), geometry.pose([0.0, 0.0, 0.0], tilt)) for p in places)


def some_angles(rng: Rng) -> Any:
    """Joint angles: of a pose, random, or invalid."""
    chance = rng.random()
    if chance < 0.45:
        return KINEMATICS.inverse(honest_pose(rng))
    if chance < 0.6:
        return rng.uniform(PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad)
    if chance < 0.7:
        return PANDA.home_q_rad + rng.normal(size=7) * 10 ** rng.uniform(-12.0, 1.0)
    angles = PANDA.home_q_rad.copy()
    if chance < 0.85:
        angles[rng.integers(7)] = rng.choice([np.nan, np.inf, -np.inf, 1e308, 9.0, -3.0719])
        return angles
    wrong = (angles[:6], np.append(angles, 0.0), angles[:0], angles[None], np.float64(1.0), None, [0.0] * 7, "home")
    return (*wrong, angles.astype(np.float32), np.array(1.0), np.tile(angles, 1000))[int(rng.integers(11))]


def some_number(rng: Rng, largest: float) -> float:
    """A number within 0 to `largest`, at its ends, outside, or not finite."""
    if rng.random() < 0.5:
        return float(rng.uniform(0.0, largest))
    odd = (np.nan, np.inf, -np.inf, 0.0, -0.0, -1e-9, 1e-300, 1e308, largest, largest * 1.001, -largest)
    return float(rng.choice(odd))


CALLS: dict[str, Callable[[Rng], tuple[Skill[..., Any], Arguments]]] = {
    "move_joints": lambda rng: (api.MOVE_JOINTS, (some_angles(rng),)),
    "move_to": lambda rng: (api.MOVE_TO, (some_pose(rng), bool(rng.random() < 0.7))),
    "move_linear": lambda rng: (api.MOVE_LINEAR, (some_pose(rng), some_profile(rng))),
    "follow_path": lambda rng: (api.FOLLOW_PATH, (some_path(rng), some_profile(rng))),
    "grasp": lambda rng: (api.GRASP, (some_number(rng, 70.0),)),
    "release": lambda rng: (api.RELEASE, (some_number(rng, 0.08),)),
    "home": lambda rng: (api.HOME, ()),
    "halt": lambda rng: (api.HALT, ()),
    "stop": lambda rng: (api.STOP, ()),
    "recover": lambda rng: (api.RECOVER, ()),
    "renew_lease": lambda rng: (api.RENEW_LEASE, ("memory", some_number(rng, 0.5))),
    "release_lease": lambda rng: (api.RELEASE_LEASE, ("memory",)),
}
"""A call of each skill of the robot, drawn at random."""
SHARES = {"move_joints": 6.0, "move_to": 6.0, "move_linear": 6.0, "follow_path": 6.0, "grasp": 2.0, "release": 2.0}
"""Relative frequencies of the calls; 1 unless listed."""
