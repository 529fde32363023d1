"""Perception as a component: looks on demand and while tracking, publishes pictures and points."""

import asyncio
import dataclasses
import logging
from collections.abc import Callable

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.errors import HardwareError, SkillFailure, SkillRejected
from dlokit.functional.cameras.base import Camera
from dlokit.skills.perception import api
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.box import BoxConfig
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.pipeline import corrected_camera_pose, loaded, observe
from dlokit.skills.perception.releases import Releases
from dlokit.skills.perception.segmentations import from_spec
from dlokit.skills.perception.shift import Shift, offset_after_release
from dlokit.types.arrays import Float64Array
from dlokit.types.image import StereoImages
from dlokit.types.observation import Gripped, GripperPin, Observation
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState
from dlokit.types.strategy import StrategySpec

log = logging.getLogger(__name__)


class PerceptionComponent(Component):
    """Turns the camera's pictures into the DLO's points in the world."""

    name = "perception"
    publishes = (topics.STEREO_IMAGES, topics.OBSERVATION)

    def __init__(self, config: PerceptionConfig, camera: Camera) -> None:
        self._config = config
        self._segmentation: SegmentationConfig = config.segmentation
        self._camera = camera
        self._rate_hz = config.tracking_rate_hz
        self._rate_changed = asyncio.Event()
        self._looking = asyncio.Lock()
        self._robots: dict[str, RobotState] = {}
        self._gripped: dict[str, Gripped] = {}
        self._looks = 0
        self._T_world_camera: Pose | None = None
        self._releases = Releases(config.shift.highest_m)
        self._shift = Shift.unknown(config.shift)

    @implements(api.LOOK)
    async def look(self) -> Observation:
        """Look once, after a look that is under way."""
        async with self._looking:
            observation = await self._look_once()
        if len(observation.points_world) == 0:
            raise SkillFailure(
                "no_points",
                "nothing in the picture passes the segmentation, the box and the robot filter; compare the picture "
                "with their settings (set_segmentation, set_box)",
            )
        return observation

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
        self._segmentation = from_spec(spec)

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
        """Remember where the robot is."""
        self._robots[state.robot] = state
        self._releases.moved(state)

    @on(topics.GRIPPED)
    async def on_gripped(self, gripped: Gripped) -> None:
        """Remember which node is held, or where it was let go."""
        self._releases.gripped(gripped, self._robots.get(gripped.robot))
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
                    await self._rate_changed.wait()

    async def _track(self) -> None:
        """One look and the wait for the next; looks that are due while another is under way are left out."""
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
                log.warning("tracking look left out: %s", failure)

    async def _look_once(self) -> Observation:
        """Pictures and points of one look, published."""
        images = await self._capture()
        self.port.publish(topics.STEREO_IMAGES, images)
        robots = tuple(self._robots.values())
        images = await self._with_corrected_pose(images, robots)
        observation = await self.port.compute(observe, images, robots, self._config, self._segmentation, self._pins())
        self._looks += 1
        self._learn_shift(observation, robots)
        self.port.publish(topics.OBSERVATION, observation)
        return observation

    async def _capture(self) -> StereoImages:
        try:
            images = await self._camera.capture(self._config.capture_timeout_s)
        except HardwareError as error:
            raise SkillFailure("camera_lost", str(error)) from error
        if not isinstance(images, StereoImages):
            raise SkillFailure(
                "camera_lost", f"the camera gave a {type(images).__name__}; perception matches stereo pairs only"
            )
        return images

    async def _with_corrected_pose(self, images: StereoImages, robots: tuple[RobotState, ...]) -> StereoImages:
        """The pair with the camera pose corrected by the table and by what was released on it."""
        pose = await self._by_the_table(images, robots)
        if self._config.shift.correct:
            pose = self._shift.corrected(pose)
        calibration = msgspec.structs.replace(images.calibration, T_world_camera=pose)
        return msgspec.structs.replace(images, calibration=calibration)

    async def _by_the_table(self, images: StereoImages, robots: tuple[RobotState, ...]) -> Pose:
        """T_world_camera corrected by the table, which is looked for now and then."""
        table = self._config.table
        if table.correct_pose and self._looks % table.every_looks == 0:
            found = await self.port.compute(corrected_camera_pose, images, robots, self._config, self._segmentation)
            if found is None:
                log.warning("the table's plane was not found; the camera pose stays as it was")
            self._T_world_camera = found or self._T_world_camera
        return self._T_world_camera or images.calibration.T_world_camera

    def _learn_shift(self, observation: Observation, robots: tuple[RobotState, ...]) -> None:
        """How far the rod is seen beside where it was let go; later looks are corrected by it."""
        settings = self._config.shift
        for release in self._releases.in_view(robots) if settings.correct else ():
            measured = offset_after_release(observation.points_world, release, settings)
            if measured is None:
                continue
            self._shift = self._shift.after(measured, settings.gate)
            x_mm, y_mm = (1e3 * self._shift.mean_m).tolist()
            log.info(
                "the released rod is seen %.1f mm beside its place; the camera is taken to be off by (%.1f, %.1f) mm",
                1e3 * measured.offset_m, x_mm, y_mm,
            )  # fmt: skip

    def _pins(self) -> tuple[GripperPin, ...]:
        return tuple(
            _pin(self._robots[robot].T_world_tcp, gripped.node, gripped)
            for robot, gripped in self._gripped.items()
            if robot in self._robots and gripped.node is not None
        )


def _pin(T_world_tcp: Pose, node: int, gripped: Gripped) -> GripperPin:
    """The held node where the tool has carried it."""
    node_tcp = np.zeros(3) if gripped.node_tcp is None else gripped.node_tcp
    place = geometry.transform(T_world_tcp, node_tcp[None, :])[0]
    return GripperPin(robot=gripped.robot, node=node, position_world=place.astype(np.float32))
