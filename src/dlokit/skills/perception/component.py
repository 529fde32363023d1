"""Perception as a component: looks on demand and while tracking, publishes pictures and points."""

import asyncio
import dataclasses
import logging
from collections.abc import Callable
from functools import partial

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.scene import Scene
from dlokit.errors import ClockJumped, HardwareError, SkillFailure, SkillRejected
from dlokit.functional.cameras.base import JUMP_NS, Camera
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.perception import api
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.calibration.hand_sight import HandLook, camera_from_hand, corrected_by
from dlokit.skills.perception.config import BoxConfig, PerceptionConfig, from_spec, to_spec
from dlokit.skills.perception.fixture_check import check_fixtures
from dlokit.skills.perception.pipeline import corrected_camera_pose, loaded, observe, without_points
from dlokit.skills.perception.rectification import rectified
from dlokit.skills.perception.robot_history import RobotHistory
from dlokit.types.arrays import Float64Array
from dlokit.types.fixtures import FixtureCheck
from dlokit.types.image import CameraCheck, CameraPictures, DepthImage, StereoImages
from dlokit.types.observation import CameraView, GraspState, GripperPin, LookResult, Observation
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT, RobotState
from dlokit.types.system import StrategyChosen, StrategySpec

log = logging.getLogger(__name__)

_STATE_WAIT_S = 0.02
_STATE_WAITS = 50
_SHORT_WAITS = 5
"""Number of waits for states in a look, which then continues without a silent robot."""
_SILENT_NS = 200_000_000
"""A robot without a state for this long is silent [ns of the run's clock]; ten states are missing."""
_CLOCK_WAITS = 10
"""Number of waits until the run's clock reaches the stamp of pictures; a tick arrives every 10 ms."""


_NO_FIXTURES = Scene()
_DEPTH_PICTURES, _PICTURES_APART_S = 6, 0.5
"""Pictures of a depth camera for a look at the fixtures: the noise of one, 5 mm of depth, is as high as a DLO. The wait
after each [s] is that of a recording, whose replay needs all of them, and the next one."""
_TABLE_EVERY_LOOKS = 50
"""The table is searched in the first look, and again after this many."""


class PerceptionComponent(Component):
    """Turns the camera's pictures into the DLO's points in the world."""

    name = "perception"
    publishes = (topics.STEREO_IMAGES, topics.DEPTH_IMAGES, topics.OBSERVATION, topics.CAMERA, topics.SEGMENTATION)

    def __init__(
        self,
        config: PerceptionConfig,
        camera: Camera,
        dlo: BelievedDlo,
        arms: tuple[ArmMount, ...] = FIRST_ALONE,
        scene: Scene = _NO_FIXTURES,
    ) -> None:
        """`arms` are the arms in view; an unknown name, as in older recordings, counts as the first arm.

        Of the believed `scene` the fixtures are removed from the clouds.
        """
        self._config = config
        self._fixtures = scene.fixtures
        self._dlo = dlo
        self._first = arms[0]
        self._models = {mount.robot: mount.model for mount in arms}
        self._segmentation: SegmentationConfig = config.segmentation
        self._camera = camera
        self._rate_hz = config.tracking_rate_hz
        self._rate_changed = asyncio.Event()
        self._looking = asyncio.Lock()
        self._robots = RobotHistory()
        self._arrived_ns: dict[str, int] = {}
        self._gripped: dict[str, GraspState] = {}
        self._looks = 0
        self._T_world_camera: Pose | None = None
        self._background: CameraPictures | None = None
        self._hand_looks: list[HandLook] = []
        self._camera_check: CameraCheck | None = None

    @implements(api.LOOK)
    async def look(self) -> LookResult:
        """Look once, after the current look."""
        async with self._looking:
            observation = await self._look_once()
        if len(observation.points_world) == 0:
            raise SkillFailure(
                "no_points",
                "nothing in the picture passes the segmentation, the box and the robot filter; compare the picture "
                "with their settings (the page's tab Mask shows both; set_segmentation, set_box)",
            )
        return LookResult(stamp_ns=observation.stamp_ns, points=len(observation.points_world))

    @implements(api.NOTE_BACKGROUND)
    async def note_background(self) -> None:
        """Begin a check of the camera's pose with a picture of the scene without the hand."""
        async with self._looking:
            images = await self._capture()
            images = await self._by_the_table(images, await self._robots_at(images.stamp_ns))
        self._background = rectified(images)
        self._hand_looks = []

    @implements(api.SEE_HAND)
    async def see_hand(self, robot: str = FIRST_ROBOT) -> None:
        """Take a picture of the hand at its present position."""
        async with self._looking:
            images = await self._capture()
        state = await self._robot_at(self._first.robot if robot == FIRST_ROBOT else robot, images.stamp_ns)
        (posed,) = self._posed((state,))
        self._hand_looks.append(HandLook(images=rectified(images), robot=posed))

    @implements(api.CHECK_CAMERA)
    async def check_camera(self) -> CameraCheck:
        """Compute the camera's pose from the pictures of the hand, which are then deleted."""
        background, looks = self._background, self._hand_looks
        self._background, self._hand_looks, self._camera_check = None, [], None
        if background is None or not looks:
            raise SkillRejected("no_pictures", "call note_background, then see_hand once or more, then check_camera")
        self._camera_check = await self.port.compute(camera_from_hand, background, looks)
        return self._camera_check

    @implements(api.CHECK_FIXTURES)
    async def check_fixtures(self) -> FixtureCheck:
        """Compare what stands on the table with the believed fixtures."""
        async with self._looking:
            pictures = [await self._capture()]
            robots = tuple([await self._robot_at(robot, pictures[0].stamp_ns) for robot in self._models])
            T_world_camera = self._by_the_hand(await self._by_the_table(pictures[0], robots)).calibration.T_world_camera
            await self.port.clock.sleep(_PICTURES_APART_S)
            while isinstance(pictures[0], DepthImage) and len(pictures) < _DEPTH_PICTURES:
                pictures.append(await self._capture())
                await self.port.clock.sleep(_PICTURES_APART_S)
        return await self.port.compute(
            partial(check_fixtures, pose_known=self._camera_check is not None),
            [_seen_from(picture, T_world_camera) for picture in pictures],
            self._posed(robots),
            self._config,
            self._segmentation,
            self._fixtures,
        )

    @implements(api.SET_BOX)
    async def set_box(self, lower_world: Float64Array, upper_world: Float64Array) -> None:
        """Change the box."""
        if lower_world.shape != (3,) or upper_world.shape != (3,):
            raise SkillRejected("bad_box", f"corners must be (3,), not {lower_world.shape} and {upper_world.shape}")
        (x0, y0, z0), (x1, y1, z1) = lower_world.tolist(), upper_world.tolist()
        try:
            box = BoxConfig(lower_world=(x0, y0, z0), upper_world=(x1, y1, z1))
        except ValueError as error:
            raise SkillRejected("bad_box", str(error)) from error
        self._config = dataclasses.replace(self._config, box=box)

    @implements(api.SET_SEGMENTATION)
    async def set_segmentation(self, spec: StrategySpec) -> None:
        """Change the strategy that finds the DLO's pixels."""
        wanted = from_spec(spec)
        if self._gripped:
            raise SkillRejected(
                "dlo_held",
                f"the gripper of {', '.join(self._gripped)} holds the DLO, which the observer could lose with other "
                "settings; change them after the release",
            )
        self._segmentation = wanted
        self.port.publish(
            topics.SEGMENTATION,
            StrategyChosen(stamp_ns=self.port.clock.now_ns(), spec=to_spec(wanted)),
        )

    @implements(api.SET_TRACKING)
    async def set_tracking(self, rate_hz: float) -> None:
        """Change the rate of looks."""
        self._rate_hz = rate_hz
        self._rate_changed.set()

    def preparation(self) -> Callable[[], object]:
        """Load the libraries that a look needs."""
        return loaded

    @on(topics.ROBOT_STATE)
    async def on_robot_state(self, state: RobotState) -> None:
        """Note the robot's state."""
        self._robots.add(state)
        self._arrived_ns[state.robot] = self.port.clock.now_ns()

    @on(topics.GRIPPED)
    async def on_gripped(self, gripped: GraspState) -> None:
        """Note the held nodes."""
        if gripped.node is None:
            self._gripped.pop(gripped.robot, None)
        else:
            self._gripped[gripped.robot] = gripped

    async def run(self) -> None:
        """Hold the camera open, and look at the set rate."""
        with self._camera:
            while True:
                if self._rate_hz > 0.0:
                    await self._track()
                else:
                    self._rate_changed.clear()
                    await self._rate_changed.wait()  # until a rate is set, or the component ends

    async def _track(self) -> None:
        """One look and the wait for the next; looks that are due during another are skipped."""
        period_ns = round(1e9 / self._rate_hz)
        due_ns = self.port.clock.now_ns() + period_ns
        if not self._looking.locked():
            await self._tracking_look()
        late_ns = self.port.clock.now_ns() - due_ns
        if late_ns > 0:
            due_ns += -(-late_ns // period_ns) * period_ns
        await self.port.clock.sleep_until(due_ns)

    async def _tracking_look(self) -> None:
        async with self._looking:
            try:
                await self._look_once()
            except SkillFailure as failure:
                log.warning("tracking look skipped: %s", failure)

    async def _look_once(self) -> Observation:
        """Pictures and points of one look, published."""
        images = await self._capture()
        robots = await self._robots_at(images.stamp_ns)
        posed = self._posed(robots)
        images = self._by_the_hand(await self._by_the_table(images, robots))
        try:
            observation = await self.port.compute(
                observe,
                images,
                posed,
                self._config,
                self._segmentation,
                self._dlo.radius_m,
                self._pins(robots),
                self._fixtures,
            )
        except SkillFailure:  # without this observation, the observer would keep its nodes
            self._publish(without_points(images))
            raise
        self._looks += 1
        self._publish(observation)
        return observation

    def _publish(self, observation: Observation) -> None:
        self.port.publish(topics.OBSERVATION, observation)
        if observation.calibration is not None:
            view = CameraView(stamp_ns=observation.stamp_ns, calibration=observation.calibration)
            self.port.publish(topics.CAMERA, view)

    async def _capture(self) -> CameraPictures:
        """The camera's pictures, published; those with a wrong stamp are refused."""
        asked_ns = self.port.clock.now_ns()
        try:
            images = await self._camera.capture(self._config.capture_timeout_s)
        except ClockJumped as error:
            raise SkillFailure(api.CLOCK_JUMPED, str(error)) from error
        except HardwareError as error:
            raise SkillFailure(api.CAMERA_LOST, str(error)) from error
        await self._check_stamp(images.stamp_ns, asked_ns)
        match images:
            case StereoImages():
                self.port.publish(topics.STEREO_IMAGES, images)
            case DepthImage():
                self.port.publish(topics.DEPTH_IMAGES, images)
        return images

    async def _check_stamp(self, stamp_ns: int, asked_ns: int) -> None:
        """Refuse a stamp that is not between request and arrival, because the robot was at another pose then."""
        late_ns, early_ns = await self._ahead_ns(stamp_ns), asked_ns - stamp_ns
        if max(late_ns, early_ns) <= JUMP_NS:
            return
        off = f"{late_ns / 1e9:.3f} s after they arrived" if late_ns > 0 else f"{early_ns / 1e9:.3f} s before the call"
        raise SkillFailure(
            api.WRONG_STAMP,
            f"the pictures are stamped {off}: the camera's driver must convert its device's clock to that of the run, "
            "the host's monotonic clock (dlokit.functional.cameras.device_clock does it)",
        )

    async def _check_robots_clock(self, stamp_ns: int) -> None:
        """Refuse pictures when the states of a robot that sends them are stamped by another clock."""
        for robot in self._robots.robots:
            newest = self._robots.newest(robot)
            assert newest is not None, "a robot is known by its states"
            off_ns = self._robots.off_ns(robot, stamp_ns)
            silent = self.port.clock.now_ns() - self._arrived_ns.get(robot, 0) > _SILENT_NS
            if silent and off_ns < 0:
                continue  # it is at its last position
            if (ahead_ns := await self._ahead_ns(newest.stamp_ns)) > JUMP_NS:
                off_ns = ahead_ns
            if abs(off_ns) > JUMP_NS:
                raise SkillFailure(
                    api.WRONG_STAMP,
                    f"the states of the robot {robot} are stamped {off_ns / 1e9:+.3f} s off the pictures: its driver, "
                    "or the camera's, does not convert its device's clock to that of the run",
                )

    async def _ahead_ns(self, stamp_ns: int) -> int:
        """Time by which a stamp is ahead of the run's clock [ns], whose next tick may not have been read yet."""
        for _ in range(_CLOCK_WAITS):
            if stamp_ns <= self.port.clock.now_ns() + JUMP_NS:
                break
            await self.port.clock.sleep(_STATE_WAIT_S)
        return stamp_ns - self.port.clock.now_ns()

    async def _by_the_table(self, images: CameraPictures, robots: tuple[RobotState, ...]) -> CameraPictures:
        """The pictures with the camera pose corrected by the table, which is searched at intervals."""
        if self._config.table.correct_pose and self._looks % _TABLE_EVERY_LOOKS == 0:
            found = await self.port.compute(
                corrected_camera_pose, images, self._posed(robots), self._config, self._segmentation
            )
            if found is None:
                log.warning("the table's plane was not found; the camera pose stays as it was")
            self._T_world_camera = found or self._T_world_camera
        return _seen_from(images, self._T_world_camera or images.calibration.T_world_camera)

    def _by_the_hand(self, images: CameraPictures) -> CameraPictures:
        """The pictures with the camera pose corrected by the check with the hand."""
        check = self._camera_check
        return images if check is None else _seen_from(images, corrected_by(images.calibration.T_world_camera, check))

    def _posed(self, robots: tuple[RobotState, ...]) -> tuple[PosedArm, ...]:
        return tuple(PosedArm(self._models.get(state.robot, self._first.model), state) for state in robots)

    async def _robot_at(self, robot: str, stamp_ns: int) -> RobotState:
        """State of a robot at a time, after a short wait; states arrive many times per second."""
        state = await self._awaited(robot, stamp_ns, _STATE_WAITS)
        await self._check_robots_clock(stamp_ns)
        if state is None:
            raise SkillFailure("robot_lost", f"no state of the {robot} arm came after the pictures; is it running?")
        return state

    async def _robots_at(self, stamp_ns: int) -> tuple[RobotState, ...]:
        """States of all robots at a time; for a silent robot, its last state."""
        states = [await self._awaited(robot, stamp_ns, _SHORT_WAITS) for robot in self._robots.robots]
        await self._check_robots_clock(stamp_ns)
        last = [self._robots.newest(robot) for robot in self._robots.robots]
        return tuple(state for pair in zip(states, last, strict=True) if (state := pair[0] or pair[1]) is not None)

    async def _awaited(self, robot: str, stamp_ns: int, waits: int) -> RobotState | None:
        for _ in range(waits):
            if (state := self._robots.at(robot, stamp_ns)) is not None:
                return state
            await self.port.clock.sleep(_STATE_WAIT_S)
        return self._robots.at(robot, stamp_ns)

    def _pins(self, robots: tuple[RobotState, ...]) -> tuple[GripperPin, ...]:
        where = {state.robot: state.T_world_tcp for state in robots}
        return tuple(
            _pin(where[robot], gripped.node, gripped)
            for robot, gripped in self._gripped.items()
            if robot in where and gripped.node is not None
        )


def _pin(T_world_tcp: Pose, node: int, gripped: GraspState) -> GripperPin:
    """The held node at its position in the tool."""
    node_tcp = np.zeros(3) if gripped.node_tcp is None else gripped.node_tcp
    place = geometry.transform(T_world_tcp, node_tcp[None, :])[0]
    return GripperPin(robot=gripped.robot, node=node, position_world=place.astype(np.float32))


def _seen_from(images: CameraPictures, T_world_camera: Pose) -> CameraPictures:
    """The same pictures with another camera pose."""
    calibration = msgspec.structs.replace(images.calibration, T_world_camera=T_world_camera)
    return msgspec.structs.replace(images, calibration=calibration)
