"""The hardware of the ideal lab: its rope, camera and arm do what the test scripts, including failures."""

import asyncio
from dataclasses import dataclass, field

import numpy as np
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.errors import SkillFailure
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.fixtures import FixtureCheck, FixtureFinding
from dlokit.types.image import CameraCheck
from dlokit.types.observation import LookResult, Observation
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT, GripResult, MotionResult

LENGTH_M = 0.5
NODES = 21
"""As few as the shapes need: most of a run is the physics of the model, which grows with them."""


@dataclass
class Lab:
    """State shared by the scripted hardware: the rope's shape, and which skill fails when."""

    nodes: Float64Array  # (NODES, 3) [m]
    fails: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Skill → the named failures of its next calls; an empty name succeeds."""
    brakes_after: int = 0
    """Number of poses that an arm has reached on its path when a scripted failure ends the motion."""
    loses_at_brake: bool = False
    """Whether the fingers lose the rope when a scripted failure ends a motion along a path."""
    paths: list[tuple[Pose, ...]] = field(default_factory=list[tuple[Pose, ...]])
    """The paths that the arm was told to follow."""
    holds: bool = True
    """Whether grasps succeed."""
    feels: bool = False
    """Whether the arm's state reports a grasped object; the model then follows the tool."""
    slips: int = 0
    """Number of next carries that lose the rope half way."""
    obeys: bool = True
    """Whether the rope follows the gripper."""
    confuses_ends: bool = False
    """Whether the model loses track behind the arm and reverses the order of the rope."""
    checks_camera: bool = False
    """Whether its tasks check the camera with the hand first."""
    findings: list[tuple[FixtureFinding, ...]] = field(default_factory=list[tuple[FixtureFinding, ...]])
    """Results of the next looks at the fixtures; later ones find nothing."""
    calls: list[str] = field(default_factory=list[str])

    def enter(self, skill: str) -> None:
        """Count a call, and fail it if scripted."""
        self.calls.append(skill)
        script = self.fails.get(skill, [])
        if script and (reason := script.pop(0)):
            raise SkillFailure(reason, "by the script")


class ScriptedPerception(Component):
    """Sees points on the centre line of the rope."""

    name = "perception"
    publishes = (topics.OBSERVATION,)

    def __init__(self, lab: Lab) -> None:
        self._lab = lab

    @implements(perception.LOOK)
    async def look(self) -> LookResult:
        self._lab.enter("look")
        points = geometry.resample(self._lab.nodes, 600).astype(np.float32)
        seen = Observation(stamp_ns=self.port.clock.now_ns(), points_world=points)
        self.port.publish(topics.OBSERVATION, seen)
        return LookResult(stamp_ns=seen.stamp_ns, points=len(points))

    @implements(perception.NOTE_BACKGROUND)
    async def note_background(self) -> None:
        self._lab.enter("note_background")

    @implements(perception.SEE_HAND)
    async def see_hand(self, robot: str = FIRST_ROBOT) -> None:
        self._lab.enter("see_hand")

    @implements(perception.CHECK_CAMERA)
    async def check_camera(self) -> CameraCheck:
        self._lab.enter("check_camera")
        return CameraCheck(
            offset_m=np.array([0.003, -0.004]), yaw_rad=-0.001, center_world=np.zeros(2), scatter_m=1e-4, points=1000
        )

    @implements(perception.CHECK_FIXTURES)
    async def check_fixtures(self) -> FixtureCheck:
        self._lab.enter("check_fixtures")
        findings = self._lab.findings.pop(0) if self._lab.findings else ()
        return FixtureCheck(stamp_ns=self.port.clock.now_ns(), findings=findings, camera_offset_m=np.zeros(2))

    @implements(perception.SET_TRACKING)
    async def set_tracking(self, rate_hz: float) -> None:
        self._lab.calls.append(f"tracking {rate_hz:g}")


class ScriptedRobot(Component):
    """An arm that reaches its targets at once, and a rope that is dragged by its nodes."""

    name = "robot"
    publishes = (topics.ROBOT_STATE,)

    def __init__(self, lab: Lab) -> None:
        self._lab = lab
        self._tcp = geometry.downward([0.3, 0.0, 0.4], 0.0)
        self._held: int | None = None
        self._shut = False
        self._stopped = asyncio.Event()

    async def run(self) -> None:
        while True:
            self._tell()
            await self.port.clock.sleep(0.1)

    def _motion(self, target: Pose) -> MotionResult:
        self._tcp = target
        self._tell()
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=target, duration_s=1.0, largest_joint_error_rad=0.0)

    def _pull(self, target: Pose) -> None:
        if self._held is not None and self._lab.obeys:
            self._lab.nodes = dragged(self._lab.nodes, self._held, target.position_m)

    def _tell(self) -> None:
        self.port.publish(
            topics.ROBOT_STATE,
            structs.replace(
                ARM_AT_REST,
                stamp_ns=self.port.clock.now_ns(),
                T_world_tcp=self._tcp,
                holding=self._lab.feels and self._held is not None,
            ),
        )

    @implements(robot.HOME)
    async def home(self) -> MotionResult:
        self._lab.enter("home")
        await self.port.clock.sleep(1.0)
        return self._motion(geometry.downward([0.3, 0.0, 0.4], 0.0))

    @implements(robot.MOVE_TO)
    async def move_to(self, target: Pose, either_way: bool = True) -> MotionResult:
        self._lab.enter("move_to")
        await self.port.clock.sleep(1.0)
        return self._motion(target)

    @implements(robot.MOVE_LINEAR)
    async def move_linear(self, target: Pose, velocity: VelocityProfile) -> MotionResult:
        self._lab.enter("move_linear")
        self._pull(target)
        return self._motion(target)

    @implements(robot.GRASP)
    async def grasp(self, force_n: float = 20.0) -> GripResult:
        self._lab.enter("grasp")
        if self._lab.holds:
            self._hold_nearest()
        return GripResult(width_m=0.008 if self._lab.holds else 0.0, held=self._lab.holds)

    def _hold_nearest(self) -> None:
        self._held = int(np.argmin(np.linalg.norm(self._lab.nodes - self._tcp.position_m, axis=1)))

    @implements(robot.FOLLOW_PATH)
    async def follow_path(self, path: tuple[Pose, ...], velocity: VelocityProfile) -> MotionResult:
        self._lab.paths.append(path)
        try:
            self._lab.enter("follow_path")
        except SkillFailure:
            for reached in path[: self._lab.brakes_after]:
                self._pull(reached)
                self._motion(reached)
            if self._lab.loses_at_brake:
                self._held = None
                self._tell()
            raise
        if self._lab.slips > 0:
            await self._lose()
        await self.port.clock.sleep(2.0)
        if self._shut:
            self._hold_nearest()
        self._pull(path[-1])
        if self._lab.confuses_ends:
            await self.port.call(model.RESET)
            await self.port.call(perception.LOOK)
            await self.port.call(observer.INITIALISE, self.port.clock.now_ns(), self._lab.nodes[::-1].copy())
        return self._motion(path[-1])

    async def _lose(self) -> None:
        """The fingers close, and the arm moves on until it is stopped."""
        self._lab.slips -= 1
        await self.port.clock.sleep(1.0)
        self._held = None
        await self.port.clock.sleep(5.0)
        if self._stopped.is_set():
            self._stopped.clear()
            raise SkillFailure("stopped", "as it was told")

    @implements(robot.RELEASE)
    async def release(self, width_m: float = 0.04) -> GripResult:
        self._lab.enter("release")
        self._held, self._shut = None, width_m == 0.0
        return GripResult(width_m=width_m, held=False)

    @implements(robot.RECOVER)
    async def recover(self) -> None:
        self._lab.enter("recover")

    @implements(robot.HALT)
    async def halt(self) -> None:
        self._lab.calls.append("halt")
        self._stopped.set()

    @implements(robot.STOP)
    async def stop(self) -> None:
        self._lab.calls.append("stop")
        self._stopped.set()


STRAIGHTENINGS = 8
"""Rounds in which the rope straightens after a pull. Without them it crumples from node to node, more finely than an
observer can see."""


def dragged(nodes: Float64Array, held: int, to: Float64Array) -> Float64Array:
    """The rope after node `held` was moved to `to`; it drags the others along, keeps its length, and straightens."""
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    moved = nodes.copy()
    moved[held, :2] = to[:2]
    result = _followed(moved, held, steps)
    for _ in range(STRAIGHTENINGS):
        straighter = result.copy()
        straighter[1:-1] += 0.25 * (result[:-2] - 2.0 * result[1:-1] + result[2:])
        straighter[held] = result[held]
        result = _followed(straighter, held, steps)
    return result


def _followed(nodes: Float64Array, held: int, steps: Float64Array) -> Float64Array:
    """The rope with its segments at their lengths again, from the held node outwards."""
    result = nodes.copy()
    for side in (range(held - 1, -1, -1), range(held + 1, len(nodes))):
        for i in side:
            leader = i + 1 if i < held else i - 1
            gap = result[i] - result[leader]
            result[i] = result[leader] + gap / np.linalg.norm(gap) * steps[min(i, leader)]
    return result
