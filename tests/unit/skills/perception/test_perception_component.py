import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np
import pytest
from stereo_scene import ROPE_RADIUS_M, Scene

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.wire import codec
from dlokit.description import scene as scenes
from dlokit.errors import HardwareError
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.perception import api
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.component import PerceptionComponent
from dlokit.skills.perception.config import PerceptionConfig, TableConfig, from_spec, to_spec
from dlokit.types.fixtures import FixtureSight
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.observation import GraspState, Observation
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import FIRST_ROBOT, RobotState
from dlokit.types.system import StrategySpec

NO_CORRECTION = PerceptionConfig(table=TableConfig(correct_pose=False))


class ScriptedCamera:
    """A camera that returns one scene's images after a delay, stamped with the clock, or fails."""

    def __init__(self, scene: Scene, *, exposure_s: float = 0.0) -> None:
        self.images: CameraPictures = scene.images
        self.exposure_s = exposure_s
        self.gone = False
        self.taken_ns: list[int] = []
        self.steps: list[str] = []

    @property
    def calibration(self) -> CameraCalibration:
        return self.images.calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        clock = LoopClock()
        if self.gone:
            raise HardwareError("the cable is out")
        self.taken_ns.append(clock.now_ns())
        await clock.sleep(self.exposure_s)
        return msgspec.structs.replace(self.images, stamp_ns=clock.now_ns())

    def __enter__(self) -> Self:
        self.steps.append("entered")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.steps.append("left")


class Others(Component):
    """Publishes messages of the robot and the decision layer."""

    name = "robot"
    publishes = (topics.ROBOT_STATE,)


class Deciders(Component):
    name = "decision"
    publishes = (topics.GRIPPED,)


Test = Callable[[MemoryTransport, ScriptedCamera], Coroutine[Any, Any, None]]


def with_perception(
    scene: Scene,
    test: Test,
    *,
    config: PerceptionConfig = NO_CORRECTION,
    exposure_s: float = 0.0,
    radius_m: float = ROPE_RADIUS_M,
    believed: scenes.Scene | None = None,
) -> ScriptedCamera:
    """Run a test on a bus with perception; returns the camera."""
    camera = ScriptedCamera(scene, exposure_s=exposure_s)

    async def main() -> None:
        transport = MemoryTransport()
        clock = LoopClock()
        host = Container(transport, clock)
        robot, decision = Others(), Deciders()
        perception = PerceptionComponent(
            config, camera, BelievedDlo(radius_m=radius_m), scene=believed or scenes.Scene()
        )
        for component in (robot, decision, perception):
            host.add(component)
        async with host:
            telling = asyncio.create_task(tell(robot, scene.robot, clock))
            await clock.sleep(0.001)
            await test(transport, camera)
            telling.cancel()

    virtual_time.run(main())
    return camera


async def tell(robot: Component, state: RobotState, clock: LoopClock) -> None:
    """Publish the state of an arm at rest, as often as an arm does."""
    while True:
        robot.port.publish(topics.ROBOT_STATE, msgspec.structs.replace(state, stamp_ns=clock.now_ns()))
        await clock.sleep(0.02)


def seen_by(bus: MemoryTransport) -> Observation:
    seen = bus.latest(topics.OBSERVATION).value
    assert seen is not None
    return seen


def test_the_camera_is_open_while_the_component_runs_and_closed_at_its_end(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        assert camera.steps == ["entered"]

    assert with_perception(s_scene, test).steps == ["entered", "left"]


def test_an_observation_has_the_robots_occlusion(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Succeeded)
        occlusion = seen_by(bus).occlusion
        assert occlusion is not None
        assert np.isfinite(occlusion.depth_m).any()  # the arm, in a corner of the picture

    with_perception(s_scene, test)


def test_an_observation_publishes_images_and_points_with_the_images_stamp(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Succeeded)
        pictures, points = bus.latest(topics.STEREO_IMAGES).value, bus.latest(topics.OBSERVATION).value
        assert pictures is not None
        assert points is not None
        assert pictures.stamp_ns == points.stamp_ns == outcome.result.stamp_ns == 51_000_000
        assert len(points.points_world) == outcome.result.points > 100

    with_perception(s_scene, test, exposure_s=0.05)


def test_a_depth_image_is_published_and_becomes_the_same_kind_of_cloud(s_scene: Scene):
    cell = Cell(CellConfig(), seed=0)
    image = cell.capture_depth()
    cell.close()

    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        camera.images = image
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Succeeded)
        assert bus.latest(topics.STEREO_IMAGES).value is None
        pictures, points = bus.latest(topics.DEPTH_IMAGES).value, bus.latest(topics.OBSERVATION).value
        assert pictures is not None
        assert points is not None
        assert pictures.stamp_ns == points.stamp_ns
        assert len(points.points_world) > 100
        # The first look corrects the pose by the table.
        assert points.calibration is not None
        assert points.calibration.T_world_camera != image.calibration.T_world_camera

    with_perception(s_scene, test, config=PerceptionConfig())


def test_an_observation_shifts_the_cloud_to_the_centre_line_by_the_believed_radius(s_scene: Scene):
    heights_m: list[float] = []

    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Succeeded)
        heights_m.append(float(np.median(seen_by(bus).points_world[:, 2])))

    in_the_air = replace(NO_CORRECTION, table=replace(NO_CORRECTION.table, supports=False))
    for radius_m in (0.001, 0.003):
        with_perception(s_scene, test, config=in_the_air, radius_m=radius_m)
    # Straight down it would be the 2 mm between the radii; the camera is slightly inclined.
    assert heights_m[0] - heights_m[1] == pytest.approx(0.002, abs=0.0005)


def test_an_observation_without_points_fails_by_name_and_still_publishes(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        nowhere = np.array([0.3, 0.3, 0.0]), np.array([0.4, 0.4, 0.1])
        assert isinstance(await bus.call(api.SET_BOX, *nowhere), Succeeded)
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "no_points"
        seen = bus.latest(topics.OBSERVATION).value
        assert seen is not None
        assert len(seen.points_world) == 0

    with_perception(s_scene, test)


def test_a_segmentation_that_takes_the_table_fails_by_name_and_publishes_that_nothing_is_seen(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        assert isinstance(await bus.call(api.SET_SEGMENTATION, to_spec(BrightnessConfig(lowest=1))), Succeeded)
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "too_much_segmented"
        seen = bus.latest(topics.OBSERVATION).value
        assert seen is not None
        assert len(seen.points_world) == 0

    with_perception(s_scene, test)


def test_a_lost_camera_fails_by_name(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        camera.gone = True
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Failed)
        assert (outcome.reason, outcome.detail) == ("camera_lost", "the cable is out")

    with_perception(s_scene, test)


def test_the_segmentation_is_changed_by_a_skill_call_while_running(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        assert isinstance(await bus.call(api.LOOK), Succeeded)
        black = to_spec(BrightnessConfig(lowest=255))
        assert isinstance(await bus.call(api.SET_SEGMENTATION, black), Succeeded)
        assert isinstance(await bus.call(api.LOOK), Failed)
        assert isinstance(await bus.call(api.SET_SEGMENTATION, StrategySpec(name="brightness")), Succeeded)
        assert isinstance(await bus.call(api.LOOK), Succeeded)

    with_perception(s_scene, test)


def test_a_changed_segmentation_is_published(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        assert bus.latest(topics.SEGMENTATION).value is None
        await bus.call(api.SET_SEGMENTATION, to_spec(BrightnessConfig(lowest=99)))
        chosen = bus.latest(topics.SEGMENTATION).value
        assert chosen is not None
        assert from_spec(chosen.spec) == BrightnessConfig(lowest=99)

    with_perception(s_scene, test)


def test_the_segmentation_stays_while_a_gripper_holds_the_dlo(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        for node, ends in ((7, Rejected), (None, Succeeded)):
            bus.publish(topics.GRIPPED, GraspState(stamp_ns=0, robot="first", node=node))
            await LoopClock().sleep(0.01)
            outcome = await bus.call(api.SET_SEGMENTATION, to_spec(BrightnessConfig(lowest=255)))
            assert isinstance(outcome, ends)
            assert isinstance(await bus.call(api.LOOK), Succeeded if node is not None else Failed)
            if isinstance(outcome, Rejected):
                assert outcome.reason == "dlo_held"
                assert "the gripper of first holds the DLO" in outcome.detail
                assert "after the release" in outcome.detail

    with_perception(s_scene, test)


def test_bad_settings_are_rejected_by_name(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        box = await bus.call(api.SET_BOX, np.ones(3), np.zeros(3))
        flat = await bus.call(api.SET_BOX, np.zeros(2), np.ones(2))
        spec = await bus.call(api.SET_SEGMENTATION, StrategySpec(name="magic"))
        rates = [await bus.call(api.SET_TRACKING, rate) for rate in (-1.0, float("nan"), 1e9)]
        reasons = [outcome.reason for outcome in (box, flat, spec, *rates) if isinstance(outcome, Rejected)]
        assert reasons == ["bad_box", "bad_box", "unknown_strategy", "bad_rate", "bad_rate", "bad_rate"]

    with_perception(s_scene, test)


def test_tracking_observes_at_its_rate_until_it_is_set_to_zero(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        clock = LoopClock()
        await clock.sleep(1.0)
        assert camera.taken_ns == []
        await bus.call(api.SET_TRACKING, 5.0)
        await clock.sleep(0.99)
        assert np.diff(camera.taken_ns).tolist() == [200_000_000] * 4
        await bus.call(api.SET_TRACKING, 0.0)
        await clock.sleep(1.0)
        assert len(camera.taken_ns) == 5

    with_perception(s_scene, test)


def test_a_tracking_observation_due_during_another_is_skipped(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        await bus.call(api.SET_TRACKING, 10.0)
        await LoopClock().sleep(1.0)
        # Each takes 0.25 s, so of the ten a second every third is due on time: 0, 0.3, 0.6, 0.9 s.
        assert np.diff(camera.taken_ns).tolist() == [300_000_000] * 3

    with_perception(s_scene, test, exposure_s=0.25)


def test_tracking_survives_a_camera_that_returns(s_scene: Scene, caplog: pytest.LogCaptureFixture):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        camera.gone = True
        await bus.call(api.SET_TRACKING, 5.0)
        await LoopClock().sleep(0.5)
        camera.gone = False
        await LoopClock().sleep(0.5)
        assert len(camera.taken_ns) >= 2

    with_perception(s_scene, test)
    assert "camera_lost" in caplog.text


def test_an_observation_on_demand_waits_for_the_tracking_observation(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        await bus.call(api.SET_TRACKING, 1.0)
        await LoopClock().sleep(0.1)
        assert isinstance(await bus.call(api.LOOK), Succeeded)
        assert np.diff(camera.taken_ns).tolist() == [250_000_000]

    with_perception(s_scene, test, exposure_s=0.25)


def test_the_table_corrects_the_pose_in_the_observation_but_not_in_the_images(s_scene: Scene):
    off = msgspec.structs.replace(
        s_scene.images.calibration.T_world_camera,
        position_m=s_scene.images.calibration.T_world_camera.position_m + np.array([0.0, 0.0, 0.003]),
    )

    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        calibration = msgspec.structs.replace(camera.images.calibration, T_world_camera=off)
        camera.images = msgspec.structs.replace(camera.images, calibration=calibration)
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Succeeded)
        seen, view = seen_by(bus), bus.latest(topics.CAMERA).value
        assert seen.calibration is not None
        assert view is not None
        assert codec.encode(view.calibration) == codec.encode(seen.calibration)
        corrected = view.calibration.T_world_camera.position_m[2]
        assert abs(corrected - off.position_m[2] + 0.003) < 0.0003  # a tenth of the error put in
        pictures = bus.latest(topics.STEREO_IMAGES).value
        assert pictures is not None
        assert pictures.calibration.T_world_camera.position_m[2] == off.position_m[2]

    with_perception(s_scene, test, config=PerceptionConfig())


def test_the_observation_has_the_held_node(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        for node, expected in ((7, [7]), (None, [])):
            bus.publish(topics.GRIPPED, GraspState(stamp_ns=0, robot="first", node=node))
            await LoopClock().sleep(0.001)
            outcome = await bus.call(api.LOOK)
            assert isinstance(outcome, Succeeded)
            assert [pin.node for pin in seen_by(bus).pins] == expected

    with_perception(s_scene, test)


def test_a_held_node_keeps_its_offset_from_the_tool_centre_point(s_scene: Scene):
    place_tcp = np.array([0.011, 0.0, -0.003])  # a grasp of an end, 11 mm inside the node

    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        bus.publish(topics.ROBOT_STATE, s_scene.robot)
        bus.publish(topics.GRIPPED, GraspState(stamp_ns=0, robot="first", node=7, node_tcp=place_tcp))
        await LoopClock().sleep(0.001)
        outcome = await bus.call(api.LOOK)
        assert isinstance(outcome, Succeeded)
        T = geometry.matrix(s_scene.robot.T_world_tcp)
        expected = T[:3, :3] @ place_tcp + T[:3, 3]
        (pin,) = seen_by(bus).pins
        assert np.abs(pin.position_world - expected).max() < 1e-6  # single precision

    with_perception(s_scene, test)


class OtherClock(ScriptedCamera):
    """A camera whose driver does not convert its device's clock to that of the run."""

    def __init__(self, scene: Scene, ahead_s: float) -> None:
        super().__init__(scene)
        self.ahead_ns = round(ahead_s * 1e9)

    async def capture(self, timeout_s: float) -> CameraPictures:
        pictures = await super().capture(timeout_s)
        return msgspec.structs.replace(pictures, stamp_ns=pictures.stamp_ns + self.ahead_ns)


def look_of(camera: ScriptedCamera, robot_ahead_s: float | None = None) -> tuple[str, int]:
    """The reason why a look fails, or succeeded; and how many pictures were published."""

    async def main() -> tuple[str, int]:
        transport, clock = MemoryTransport(), LoopClock()
        host, others = Container(transport, clock), Others()
        host.add(PerceptionComponent(NO_CORRECTION, camera, BelievedDlo(radius_m=ROPE_RADIUS_M)))
        host.add(others)
        async with host:
            published: list[CameraPictures] = []
            counting = asyncio.create_task(collect(transport.stream(topics.STEREO_IMAGES), published))
            await clock.sleep(10.0)
            states = asyncio.create_task(publish_states(others, robot_ahead_s))
            await clock.sleep(0.5)
            outcome = await transport.call(api.LOOK)
            states.cancel()
            await asyncio.wait({counting}, timeout=0.1)
            counting.cancel()
        return (outcome.reason if isinstance(outcome, Failed) else "succeeded"), len(published)

    return virtual_time.run(main())


async def collect(pictures: AsyncIterator[CameraPictures], published: list[CameraPictures]) -> None:
    async for one in pictures:
        published.append(one)  # noqa: PERF401  the stream does not end


async def publish_states(robot: Component, ahead_s: float | None) -> None:
    cell = Cell(CellConfig(), seed=0)
    while ahead_s is not None:
        stamp_ns = robot.port.clock.now_ns() + round(ahead_s * 1e9)
        robot.port.publish(topics.ROBOT_STATE, msgspec.structs.replace(cell.arm_state(FIRST_ROBOT), stamp_ns=stamp_ns))
        await robot.port.clock.sleep(0.02)


@pytest.mark.parametrize("ahead_s", [1.0, -1.0, 3600.0, -9.0])
def test_pictures_with_an_impossible_stamp_are_refused_by_name_and_not_published(s_scene: Scene, ahead_s: float):
    assert look_of(OtherClock(s_scene, ahead_s)) == ("wrong_stamp", 0)


@pytest.mark.parametrize("ahead_s", [0.1, -0.1])
def test_a_latency_that_can_be_calibrated_is_no_impossible_stamp(s_scene: Scene, ahead_s: float):
    assert look_of(OtherClock(s_scene, ahead_s)) == ("succeeded", 1)


@pytest.mark.parametrize("ahead_s", [1.0, -1.0])
def test_states_of_a_robot_by_another_clock_are_refused_by_name(s_scene: Scene, ahead_s: float):
    reason, _ = look_of(ScriptedCamera(s_scene), robot_ahead_s=ahead_s)
    assert reason == "wrong_stamp"


def test_states_by_the_same_clock_are_not(s_scene: Scene):
    assert look_of(ScriptedCamera(s_scene), robot_ahead_s=0.0) == ("succeeded", 1)


POST = scenes.Post(name="A", position_m=(0.35, 0.15, 0.0))
AMONG = scenes.Scene(fixtures=(POST,))


def test_a_look_at_the_fixtures_names_one_that_is_missing(s_scene: Scene):
    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        outcome = await bus.call(api.CHECK_FIXTURES)
        assert isinstance(outcome, Succeeded)
        assert [(one.name, one.sight) for one in outcome.result.findings] == [("A", FixtureSight.MISSING)]
        assert outcome.result.stamp_ns == camera.taken_ns[0]
        assert len(camera.taken_ns) == 1

    with_perception(s_scene, test, believed=AMONG)


def test_a_look_at_the_fixtures_takes_several_pictures_of_a_depth_camera(s_scene: Scene):
    cell = Cell(CellConfig(fixtures=(POST,)), seed=0)
    image = cell.capture_depth()
    cell.close()

    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        camera.images = image
        outcome = await bus.call(api.CHECK_FIXTURES)
        assert isinstance(outcome, Succeeded)
        assert len(camera.taken_ns) == len(set(camera.taken_ns)) == 6
        assert "A" in [one.name for one in outcome.result.findings]

    with_perception(s_scene, test, config=PerceptionConfig(), believed=AMONG)


def test_an_observation_among_fixtures_has_their_occlusion(s_scene: Scene):
    depths: list[int] = []

    async def test(bus: MemoryTransport, camera: ScriptedCamera) -> None:
        assert isinstance(await bus.call(api.LOOK), Succeeded)
        occlusion = seen_by(bus).occlusion
        assert occlusion is not None
        depths.append(int(np.count_nonzero(np.isfinite(occlusion.depth_m))) * occlusion.scale**2)

    with_perception(s_scene, test)
    with_perception(s_scene, test, believed=AMONG)
    assert depths[1] > depths[0]
